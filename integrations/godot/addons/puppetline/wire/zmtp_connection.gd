extends RefCounted
## A connection that speaks ZMTP 3 over TCP, as much of it as a SUB or DEALER socket needs (docs/protocol.md, "Without
## a ZeroMQ library").
##
## [method poll] does all the work and never waits. The other side says first whether it wants a token: one that does
## not is never given it.

enum State { CLOSED, CONNECTING, HANDSHAKE, READY, REFUSED, FAILED }

## Seconds that connecting and handshake may take together.
const PATIENCE := 5.0
## Bytes read in one call of [method poll].
const BYTES_A_POLL := 8 << 20
## Frames read in one call of [method poll].
const FRAMES_A_POLL := 4096
## Bytes of a command: the longest that there is, HELLO, has some 500.
const LARGEST_COMMAND := 1 << 16
## Bytes that may wait for the other side to read them.
const LARGEST_BACKLOG := 1 << 20

const _MORE := 1
const _LONG := 2
const _COMMAND := 4
const _GREETING := 64
const _VERSION := 10
const _MECHANISM := 12
const _MECHANISM_END := 32
const _USER := "puppetline"

## Bytes of a message, at most; more is refused before it is read.
var largest_message := 256 << 20
var state := State.CLOSED
## Why [member state] is REFUSED or FAILED.
var reason := ""
## Milliseconds, as [method Time.get_ticks_msec] counts them: when bytes came last.
var heard_at := 0

var _socket_type: String
var _token: PackedByteArray
var _host := ""
var _port := 0
var _resolving := IP.RESOLVER_INVALID_ID
var _tcp: StreamPeerTCP
var _give_up := 0
var _greeted := false
var _input := PackedByteArray()
var _at := 0
var _has_whole_frames := false
var _output := PackedByteArray()
var _messages: Array[PackedByteArray] = []


## [param socket_type] is "SUB" or "DEALER".
func _init(socket_type: String, token := "") -> void:
	_socket_type = socket_type
	_token = token.to_utf8_buffer()


func _notification(what: int) -> void:
	if what == NOTIFICATION_PREDELETE and _resolving != IP.RESOLVER_INVALID_ID:
		IP.erase_resolve_item(_resolving)  # a function of its own cannot be called any more


## Begin to connect. What was open before is closed.
func open(host: String, port: int) -> void:
	close()
	_host = host
	_port = port
	state = State.CONNECTING
	_give_up = Time.get_ticks_msec() + int(1000 * PATIENCE)
	if port < 1 or port > 65535:
		_end(State.FAILED, "There is no port %d: ports are numbers from 1 to 65535." % port)
	elif host.is_valid_ip_address():
		_dial(host)
	else:
		_resolving = IP.resolve_hostname_queue_item(host)


## Do what there is to do now: connect, read, answer, write.
func poll() -> void:
	if state == State.CONNECTING:
		_connect()
	if state == State.HANDSHAKE or state == State.READY:
		_exchange()
	if (state == State.CONNECTING or state == State.HANDSHAKE) and Time.get_ticks_msec() > _give_up:
		_end(State.FAILED, "No answer from %s within %d s. Is that the right port?" % [_address(), PATIENCE])


## Return the messages that have come. No more are read before these are taken.
func take() -> Array[PackedByteArray]:
	var taken := _messages
	_messages = []
	return taken


## Tell whether a message has come in part.
func is_receiving() -> bool:
	return state == State.READY and _at < _input.size()


## Send a message. What is sent before [member state] is READY is lost.
func send(body: PackedByteArray) -> void:
	if state == State.READY:
		_put_frame(0, body)


## Subscribe to just this topic.
func subscribe(topic: String) -> void:
	_put_subscription(1, topic)


## Take a subscription back.
func unsubscribe(topic: String) -> void:
	_put_subscription(0, topic)


func close() -> void:
	_end(State.CLOSED, "")
	_messages = []


func _put_subscription(on: int, topic: String) -> void:
	# The zero byte makes other topics that begin like this one not match.
	send(PackedByteArray([on]) + topic.to_utf8_buffer() + PackedByteArray([0]))


func _connect() -> void:
	if _tcp == null:
		_look_up()
	if _tcp == null:
		return
	_tcp.poll()
	match _tcp.get_status():
		StreamPeerTCP.STATUS_CONNECTED:
			_tcp.set_no_delay(true)
			state = State.HANDSHAKE
			# Signature and version make the other side name its mechanism; the rest of the greeting follows that.
			_output = PackedByteArray([0xFF, 0, 0, 0, 0, 0, 0, 0, 0, 0x7F, 3, 0])
		StreamPeerTCP.STATUS_CONNECTING:
			pass
		_:
			_end(State.FAILED, "Nobody answers at %s. Is the service running?" % _address())


func _look_up() -> void:
	if _resolving == IP.RESOLVER_INVALID_ID:
		return  # too many names are looked up at once: the deadline ends it
	match IP.get_resolve_item_status(_resolving):
		IP.RESOLVER_STATUS_DONE:
			var addresses := IP.get_resolve_item_addresses(_resolving)
			_forget_name()
			var four := addresses.filter(func(address: String) -> bool: return "." in address)
			_dial((four if not four.is_empty() else addresses)[0])
		IP.RESOLVER_STATUS_ERROR:
			_end(State.FAILED, "Nobody knows the host '%s'." % _host)


func _dial(address: String) -> void:
	_tcp = StreamPeerTCP.new()
	# A closed port is an ordinary thing here, tried again and again: the engine shall not print an error each time.
	var printing := Engine.print_error_messages
	Engine.print_error_messages = false
	_tcp.connect_to_host(address, _port)
	Engine.print_error_messages = printing


func _exchange() -> void:
	var open := true
	if _messages.is_empty() and not _has_whole_frames:
		open = _receive()
	if not _greeted:
		_read_greeting()
	if _greeted:
		_read_frames()
	if state == State.HANDSHAKE or state == State.READY:
		_write()
		if not open and not _has_whole_frames:
			_lost()


## Read what has come; return false if the connection has ended.
func _receive() -> bool:
	if _at > 0:  # what is left is the beginning of one frame, so each byte is moved once at most
		_input = _input.slice(_at)
		_at = 0
	var wanted := BYTES_A_POLL
	while wanted > 0:
		_tcp.poll()
		var available := _tcp.get_available_bytes() if _tcp.get_status() == StreamPeerTCP.STATUS_CONNECTED else -1
		if available <= 0:
			return available == 0
		var received: Array = _tcp.get_partial_data(mini(available, wanted))
		var bytes: PackedByteArray = received[1]
		_input.append_array(bytes)
		wanted -= bytes.size()
		heard_at = Time.get_ticks_msec()
		if received[0] != OK or bytes.is_empty():
			return received[0] == OK
	return true


func _write() -> void:
	if _output.is_empty():
		return
	var sent: Array = _tcp.put_partial_data(_output)
	if sent[0] == OK:
		_output = _output.slice(sent[1])
	if _output.size() > LARGEST_BACKLOG:
		_end(State.FAILED, "%s does not read what it is sent." % _address())


func _lost() -> void:
	if state == State.READY:
		_end(State.FAILED, "%s has closed the connection." % _address())
	else:
		_end(
			State.FAILED,
			"%s closed the connection without a word. Is that the right port, or has it too many clients?" % _address()
		)


## Check the greeting as far as it has come, and answer it when it is whole.
func _read_greeting() -> void:
	var come := _input.size()
	if (
		(come > 0 and _input[0] != 0xFF)
		or (come > _VERSION - 1 and not _input[_VERSION - 1] & 1)
		or (come > _VERSION and _input[_VERSION] < 3)
	):
		_end(State.FAILED, "What answers at %s does not speak ZMTP 3. Is that the service's port?" % _address())
	if come < _GREETING or state != State.HANDSHAKE:
		return
	_greeted = true
	_at = _GREETING
	var mechanism := _input.slice(_MECHANISM, _MECHANISM_END)
	var rest := mechanism.duplicate()
	rest.resize(_GREETING - _MECHANISM)
	match mechanism.get_string_from_ascii():
		"NULL":
			_output += rest
			_put_command("READY", _metadata())
		"PLAIN" when _token.is_empty():
			_end(State.REFUSED, "The service at %s wants a token, and none is set." % _address())
		"PLAIN" when _token.size() > 255:
			_end(State.REFUSED, "The token has %d bytes; at most 255 are possible." % _token.size())
		"PLAIN":
			_output += rest
			_put_command("HELLO", _short(_USER.to_ascii_buffer()) + _short(_token))
		var other:
			_end(
				State.REFUSED,
				"%s wants %s keys; this addon has tokens only. Use another of its ports." % [_address(), other]
			)


func _read_frames() -> void:
	_has_whole_frames = false
	for _frame in FRAMES_A_POLL:
		var come := _input.size() - _at
		if come < 2:
			return
		var flags := _input[_at]
		var head := 9 if flags & _LONG else 2
		if come < head:
			return
		var size := _input[_at + 1] if head == 2 else _long_size()
		if not _allowed(flags, size):
			return
		if size > come - head:
			return
		var body := _input.slice(_at + head, _at + head + size)
		_at += head + size
		if flags & _COMMAND:
			_obey(body)
		else:
			_messages.append(body)
		if state != State.HANDSHAKE and state != State.READY:
			return
	_has_whole_frames = true


func _long_size() -> int:
	var bytes := _input.slice(_at + 1, _at + 9)
	bytes.reverse()
	return bytes.decode_s64(0)


## Tell whether a frame may come; end the connection if not.
func _allowed(flags: int, size: int) -> bool:
	var is_command := flags & _COMMAND
	if flags & ~(_MORE | _LONG | _COMMAND) or (is_command and flags & _MORE):
		_end(State.FAILED, "%s sent a frame with flags %d, which ZMTP does not have." % [_address(), flags])
	elif flags & _MORE:
		_end(State.FAILED, "%s sent a message of several parts, which the service never does." % _address())
	elif not is_command and state != State.READY:
		_end(State.FAILED, "%s sent a message before the handshake was over." % _address())
	elif size < 0 or size > (LARGEST_COMMAND if is_command else largest_message):
		# A size with the highest bit set comes out below zero.
		var most := LARGEST_COMMAND if is_command else largest_message
		_end(State.FAILED, "%s announced a frame of %d bytes; at most %d are taken." % [_address(), size, most])
	else:
		return true
	return false


func _obey(body: PackedByteArray) -> void:
	# libzmq 4.3.5 writes 5E "RROR" for 05 "ERROR".
	if state == State.HANDSHAKE and body.slice(0, 5).get_string_from_ascii() == "^RROR":
		_refused(body.slice(5))
		return
	var length := 0 if body.is_empty() else body[0]
	if length == 0 or length >= body.size():
		_end(State.FAILED, "%s sent a command that is cut short." % _address())
		return
	var data := body.slice(1 + length)
	match body.slice(1, 1 + length).get_string_from_ascii():
		"WELCOME" when state == State.HANDSHAKE:
			_put_command("INITIATE", _metadata())
		"READY" when state == State.HANDSHAKE:
			state = State.READY
		"ERROR" when state == State.HANDSHAKE:
			_refused(data)
		"PING" when data.size() >= 2:
			_put_command("PONG", data.slice(2, 18))


func _refused(data: PackedByteArray) -> void:
	var code := data.slice(1).get_string_from_ascii()
	if code == "400":
		_end(State.REFUSED, "The service at %s does not know this token." % _address())
	else:
		_end(State.REFUSED, "The service at %s refuses the connection (%s)." % [_address(), code.left(80)])


func _metadata() -> PackedByteArray:
	var value := _socket_type.to_ascii_buffer()
	return _short("Socket-Type".to_ascii_buffer()) + PackedByteArray([0, 0, 0, value.size()]) + value


func _put_command(name: String, data: PackedByteArray) -> void:
	_put_frame(_COMMAND, _short(name.to_ascii_buffer()) + data)


func _put_frame(flags: int, body: PackedByteArray) -> void:
	if body.size() < 256:
		_output.append_array(PackedByteArray([flags, body.size()]))
	else:
		var size := PackedByteArray()
		size.resize(8)
		size.encode_s64(0, body.size())
		size.reverse()
		_output.append(flags | _LONG)
		_output.append_array(size)
	_output.append_array(body)


## Put the length before some bytes.
func _short(bytes: PackedByteArray) -> PackedByteArray:
	return PackedByteArray([bytes.size()]) + bytes


func _address() -> String:
	return "%s:%d" % [_host, _port]


func _end(how: State, why: String) -> void:
	state = how
	reason = why
	_forget_name()
	_tcp = null
	_greeted = false
	_has_whole_frames = false
	_input = PackedByteArray()
	_at = 0
	_output = PackedByteArray()


func _forget_name() -> void:
	if _resolving != IP.RESOLVER_INVALID_ID:
		IP.erase_resolve_item(_resolving)
		_resolving = IP.RESOLVER_INVALID_ID
