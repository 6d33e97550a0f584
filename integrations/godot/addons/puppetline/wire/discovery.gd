extends RefCounted
## Looks for services that announce themselves by multicast DNS as `_puppetline._tcp.local.`.
##
## It asks from ports of its own, so that answers come to it alone (RFC 6762, 5.1 and 6.7): the port of multicast DNS is
## another program's on most machines. What is found is a hint from the network and nothing more. Whoever holds it calls
## [method poll] in each process frame.

signal changed

const Dns := preload("dns.gd")

const TYPE := "_puppetline._tcp.local"
const GROUP := "224.0.0.251"
const PORT := 5353
## Seconds between two questions.
const INTERVAL := 5.0
## Seconds without an answer after which a service is taken for gone.
const PATIENCE := 12.0
const MOST_SERVICES := 100
const PACKETS_A_POLL := 64

## The services found, in the order of their names: dictionaries of `name`, `host`, `port`, `control` (a port, 0 if that
## is not said), `characters` (Array of names), `mechanism` ("NULL", "PLAIN", "CURVE" or empty) and `version`.
var services: Array[Dictionary] = []

var _sockets: Array[PacketPeerUDP] = []
var _heard: Dictionary = {}  # name: milliseconds
var _ask_at := 0


## Ask now, and not only when it is time to.
func search() -> void:
	_ask_at = 0


## Ask if it is time to, and read the answers that have come.
func poll() -> void:
	if Time.get_ticks_msec() >= _ask_at:
		# The second question comes soon, because datagrams get lost.
		_ask_at = Time.get_ticks_msec() + int(1000 * (INTERVAL if _ask_at > 0 else 1.0))
		_ask()
	var before := services.duplicate()
	for socket in _sockets:
		for _i in PACKETS_A_POLL:
			if socket.get_available_packet_count() <= 0:
				break
			var packet := socket.get_packet()
			_take(Dns.parse(packet), socket.get_packet_ip())
	var oldest := Time.get_ticks_msec() - int(1000 * PATIENCE)
	for name: String in _heard.keys():
		if _heard[name] < oldest:
			_heard.erase(name)
	services.assign(services.filter(func(each: Dictionary) -> bool: return each.name in _heard))
	if services != before:
		changed.emit()


## Ask in every network that this machine is in: a socket's own address says where a question to many goes.
func _ask() -> void:
	_sockets.clear()
	var question := Dns.question(TYPE, Dns.PTR)
	for address in IP.get_local_addresses():
		var socket := PacketPeerUDP.new()
		if "." in address and socket.bind(0, address) == OK and socket.set_dest_address(GROUP, PORT) == OK:
			socket.put_packet(question)
			_sockets.append(socket)


## Take note of the services that an answer names.
func _take(records: Array[Dictionary], sender: String) -> void:
	for pointer in records:
		if pointer.type == Dns.PTR and pointer.name.to_lower() == TYPE:
			var found := _service(pointer.data, records, sender)
			if found.is_empty():
				continue
			var others := services.filter(func(each: Dictionary) -> bool: return each.name != found.name)
			if others.size() < MOST_SERVICES:
				_heard[found.name] = Time.get_ticks_msec()
				others.append(found)
				others.sort_custom(func(a: Dictionary, b: Dictionary) -> bool: return a.name < b.name)
				services.assign(others)


## Put together what the records of an answer say of a service; empty if they do not say where it is.
func _service(instance: String, records: Array[Dictionary], sender: String) -> Dictionary:
	var place := _first(records, Dns.SRV, instance)
	if place.is_empty() or place.data.port == 0:
		return {}
	var addresses: Array = []
	for record in records:
		if record.type == Dns.A and record.name == place.data.target:
			addresses.append(record.data)
	var texts := _texts(_first(records, Dns.TXT, instance).get("data", PackedStringArray()))
	var control: String = texts.get("control", "").left(6)  # one digit more than ports have: it does for a wrong one
	return {
		"name": instance.trim_suffix("." + TYPE),
		# Of its addresses, the one it answers from is sure to be within reach.
		"host": sender if sender in addresses or addresses.is_empty() else addresses[0],
		"port": place.data.port,
		"control": int(control) if control.is_valid_int() and int(control) == clampi(int(control), 1, 65535) else 0,
		"characters": Array(texts.get("characters", "").split(",", false)),
		"mechanism": texts.get("mechanism", ""),
		"version": texts.get("version", ""),
	}


func _first(records: Array[Dictionary], type: int, name: String) -> Dictionary:
	for record in records:
		if record.type == type and record.name == name:
			return record
	return {}


func _texts(strings: PackedStringArray) -> Dictionary:
	var texts: Dictionary = {}
	for each in strings:
		texts[each.get_slice("=", 0)] = each.substr(each.find("=") + 1) if "=" in each else ""
	return texts
