extends RefCounted
## Finds services that announce themselves by multicast DNS as `_puppetline._tcp.local.`.
##
## Queries are sent from separate ports, so that answers are sent to these ports only (RFC 6762, 5.1 and 6.7). On most
## machines another program uses the port of multicast DNS. Answers are not authenticated. The owner calls
## [method poll] in each process frame.

signal changed

const Dns := preload("dns.gd")

const SERVICE_TYPE := "_puppetline._tcp.local"
const MULTICAST_ADDRESS := "224.0.0.251"
const MULTICAST_PORT := 5353
## Time between two queries, in seconds.
const QUERY_INTERVAL_SECONDS := 5.0
## Time without an answer after which a service is removed, in seconds.
const SERVICE_TIMEOUT_SECONDS := 12.0
const MAX_SERVICES := 100
const MAX_POLL_PACKETS := 64

## The services found, in the order of their names: dictionaries of `name`, `host`, `port`, `control` (a port, 0 if it
## is not announced), `characters` (Array of names), `mechanism` ("NULL", "PLAIN", "CURVE" or empty) and `version`.
var services: Array[Dictionary] = []

var _sockets: Array[PacketPeerUDP] = []
var _last_answer_ms: Dictionary = {}  # name: milliseconds
var _next_query_ms := 0


## Send the next query immediately.
func search() -> void:
	_next_query_ms = 0


## Send a query if it is due, and read the received answers.
func poll() -> void:
	if Time.get_ticks_msec() >= _next_query_ms:
		# The second query follows soon, because datagrams can get lost.
		_next_query_ms = Time.get_ticks_msec() + int(1000 * (QUERY_INTERVAL_SECONDS if _next_query_ms > 0 else 1.0))
		_send_query()
	var before := services.duplicate()
	for socket in _sockets:
		for _i in MAX_POLL_PACKETS:
			if socket.get_available_packet_count() <= 0:
				break
			var packet := socket.get_packet()
			_add_services(Dns.parse(packet), socket.get_packet_ip())
	var oldest := Time.get_ticks_msec() - int(1000 * SERVICE_TIMEOUT_SECONDS)
	for name: String in _last_answer_ms.keys():
		if _last_answer_ms[name] < oldest:
			_last_answer_ms.erase(name)
	services.assign(services.filter(func(each: Dictionary) -> bool: return each.name in _last_answer_ms))
	if services != before:
		changed.emit()


## Send a query to every network of this machine. The address of the socket selects the network of a multicast packet.
func _send_query() -> void:
	_sockets.clear()
	var question := Dns.question(SERVICE_TYPE, Dns.PTR)
	for address in IP.get_local_addresses():
		var socket := PacketPeerUDP.new()
		if (
			"." in address
			and socket.bind(0, address) == OK
			and socket.set_dest_address(MULTICAST_ADDRESS, MULTICAST_PORT) == OK
		):
			socket.put_packet(question)
			_sockets.append(socket)


## Add or update the services that an answer names.
func _add_services(records: Array[Dictionary], sender: String) -> void:
	for pointer in records:
		if pointer.type == Dns.PTR and pointer.name.to_lower() == SERVICE_TYPE:
			var found := _service(pointer.data, records, sender)
			if found.is_empty():
				continue
			var others := services.filter(func(each: Dictionary) -> bool: return each.name != found.name)
			if others.size() < MAX_SERVICES:
				_last_answer_ms[found.name] = Time.get_ticks_msec()
				others.append(found)
				others.sort_custom(func(a: Dictionary, b: Dictionary) -> bool: return a.name < b.name)
				services.assign(others)


## Return the service that the records of an answer describe; empty if they do not contain its address.
func _service(instance: String, records: Array[Dictionary], sender: String) -> Dictionary:
	var place := _first(records, Dns.SRV, instance)
	if place.is_empty() or place.data.port == 0:
		return {}
	var addresses: Array = []
	for record in records:
		if record.type == Dns.A and record.name == place.data.target:
			addresses.append(record.data)
	var texts := _texts(_first(records, Dns.TXT, instance).get("data", PackedStringArray()))
	var control: String = texts.get("control", "").left(6)  # one digit more than a port has, to detect too large numbers
	return {
		"name": instance.trim_suffix("." + SERVICE_TYPE),
		# Of several addresses, the sender's address is certainly reachable.
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
