extends "connection.gd"
## A ZMTP 3 connection over TCP for a SUB or DEALER socket (docs/protocol.md, "Without a ZeroMQ library").
##
## [method poll] does all the work and never blocks. The peer announces first whether it requires a token. A peer that
## does not require one never receives it.

const HostLookup := preload("host_lookup.gd")

## Maximum number of bytes that one call of [method poll] reads, so that a scene of several megabytes does not delay an
## image.
const MAX_POLL_BYTES := 1 << 20
## Size of a frame, in bytes, from which it is received into an array of its own, which is not copied.
const LONG_FRAME_BYTES := 1 << 16
## Maximum number of frames that one call of [method poll] reads.
const MAX_POLL_FRAMES := 4096
## Maximum size of a command, in bytes. The longest one, HELLO, has about 500 bytes.
const MAX_COMMAND_BYTES := 1 << 16
## Maximum number of bytes that wait to be sent. If there are more, the connection ends, because the peer does not read.
const MAX_UNSENT_BYTES := 1 << 20

const _MORE := 1
const _LONG := 2
const _COMMAND := 4
const _GREETING_BYTES := 64
const _VERSION_OFFSET := 10
const _MECHANISM_OFFSET := 12
const _MECHANISM_END_OFFSET := 32
const _USER := "puppetline"

var _socket_type: String
var _token: PackedByteArray
var _host := ""
var _port := 0
var _lookup: HostLookup  # null once the address is known
var _tcp: StreamPeerTCP
var _deadline_ms := 0
var _greeted := false
var _input := PackedByteArray()
var _position := 0
var _has_whole_frames := false
var _long := PackedByteArray()  # what has been received of a long frame
var _long_bytes := 0  # its size; 0 if no long frame is being received
var _long_flags := 0
var _output := PackedByteArray()
var _messages: Array[PackedByteArray] = []


## [param socket_type] is "SUB" or "DEALER".
func _init(socket_type: String, token := "") -> void:
	_socket_type = socket_type
	_token = token.to_utf8_buffer()


func open(host: String, port: int) -> void:
	close()
	_host = host
	_port = port
	state = State.CONNECTING
	_deadline_ms = now_ms() + int(1000 * HANDSHAKE_TIMEOUT_SECONDS)
	if port < 1 or port > 65535:
		_end(State.FAILED, "%d is not a port; expected a number from 1 to 65535." % port)
	elif host.is_valid_ip_address():
		_start_connection(host)
	else:
		_lookup = HostLookup.new(host)


func poll() -> void:
	if state == State.CONNECTING:
		_connect()
	if state == State.HANDSHAKE or state == State.READY:
		_exchange()
	if (state == State.CONNECTING or state == State.HANDSHAKE) and now_ms() > _deadline_ms:
		_end(State.FAILED, "No answer from %s within %d s. Check the port." % [_address(), HANDSHAKE_TIMEOUT_SECONDS])


func take() -> Array[PackedByteArray]:
	var taken := _messages
	_messages = []
	return taken


func is_receiving() -> bool:
	return state == State.READY and (_position < _input.size() or _long_bytes > 0)


func send(body: PackedByteArray) -> void:
	if state == State.READY:
		_put_frame(0, body)


func subscribe(topic: String) -> void:
	_put_subscription(1, topic)


func unsubscribe(topic: String) -> void:
	_put_subscription(0, topic)


func close() -> void:
	_end(State.CLOSED, "")
	_messages = []


func _put_subscription(on: int, topic: String) -> void:
	# The zero byte prevents matches with other topics that begin like this one.
	send(PackedByteArray([on]) + topic.to_utf8_buffer() + PackedByteArray([0]))


func _connect() -> void:
	if _tcp == null:
		_resolve_host()
	if _tcp == null:
		return
	_tcp.poll()
	match _tcp.get_status():
		StreamPeerTCP.STATUS_CONNECTED:
			_tcp.set_no_delay(true)
			state = State.HANDSHAKE
			# When the peer has received signature and version, it names its mechanism, on which the rest depends.
			_output = PackedByteArray([0xFF, 0, 0, 0, 0, 0, 0, 0, 0, 0x7F, 3, 0])
		StreamPeerTCP.STATUS_CONNECTING:
			pass
		_:
			_end(State.FAILED, "Cannot connect to %s. Check that the service is running." % _address())


## Connect as soon as the address of the host is known. The deadline ends the attempt if it is not.
func _resolve_host() -> void:
	if _lookup.has_failed():
		_end(State.FAILED, "The host '%s' has no known address." % _host)
		return
	var address := _lookup.address()
	if address:
		_lookup = null
		_start_connection(address)


func _start_connection(address: String) -> void:
	_tcp = StreamPeerTCP.new()
	# A closed port is expected here, and each retry would otherwise make the engine print an error.
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
			_end_by_peer()


## Read the available bytes; return false if the connection has ended.
func _receive() -> bool:
	if _position > 0:  # only the beginning of one frame remains, so each byte is moved at most once
		_input = _input.slice(_position)
		_position = 0
	var wanted := MAX_POLL_BYTES
	while wanted > 0:
		_tcp.poll()
		var available := _tcp.get_available_bytes() if _tcp.get_status() == StreamPeerTCP.STATUS_CONNECTED else -1
		if available <= 0:
			return available == 0
		if _long_bytes > 0:
			available = mini(available, _long_bytes - _long.size())
			if available == 0:
				return true
		var received: Array = _tcp.get_partial_data(mini(available, wanted))
		var bytes: PackedByteArray = received[1]
		if _long_bytes > 0:
			_long.append_array(bytes)
		else:
			_input.append_array(bytes)
		wanted -= bytes.size()
		last_receive_ms = now_ms()
		if received[0] != OK or bytes.is_empty():
			return received[0] == OK
	return true


func _write() -> void:
	if _output.is_empty():
		return
	var sent: Array = _tcp.put_partial_data(_output)
	if sent[0] == OK:
		_output = _output.slice(sent[1])
	if _output.size() > MAX_UNSENT_BYTES:
		_end(State.FAILED, "%s does not read the data sent to it." % _address())


func _end_by_peer() -> void:
	if state == State.READY:
		_end(State.FAILED, "%s has closed the connection." % _address())
	else:
		_end(
			State.FAILED,
			(
				"%s closed the connection without an error. Check the port; the service may also have too many clients."
				% _address()
			)
		)


## Check the greeting as far as it has been received, and answer it when it is complete.
func _read_greeting() -> void:
	var received := _input.size()
	if (
		(received > 0 and _input[0] != 0xFF)
		or (received > _VERSION_OFFSET - 1 and not _input[_VERSION_OFFSET - 1] & 1)
		or (received > _VERSION_OFFSET and _input[_VERSION_OFFSET] < 3)
	):
		_end(State.FAILED, "The program at %s does not support ZMTP 3. Check the port." % _address())
	if received < _GREETING_BYTES or state != State.HANDSHAKE:
		return
	_greeted = true
	_position = _GREETING_BYTES
	var mechanism := _input.slice(_MECHANISM_OFFSET, _MECHANISM_END_OFFSET)
	var rest := mechanism.duplicate()
	rest.resize(_GREETING_BYTES - _MECHANISM_OFFSET)
	match mechanism.get_string_from_ascii():
		"NULL":
			_output += rest
			_put_command("READY", _metadata())
		"PLAIN" when _token.is_empty():
			_end(State.REFUSED, "The service at %s requires a token, and none is set." % _address())
		"PLAIN" when _token.size() > 255:
			_end(State.REFUSED, "The token has %d bytes; expected at most 255." % _token.size())
		"PLAIN":
			_output += rest
			_put_command("HELLO", _short(_USER.to_ascii_buffer()) + _short(_token))
		var other:
			_end(
				State.REFUSED,
				"%s requires %s keys; this addon supports tokens only. Use another port." % [_address(), other]
			)


func _read_frames() -> void:
	_has_whole_frames = false
	if _long_bytes > 0 and not _read_long_frame():
		return
	for _frame in MAX_POLL_FRAMES:
		var available := _input.size() - _position
		if available < 2:
			return
		var flags := _input[_position]
		var head := 9 if flags & _LONG else 2
		if available < head:
			return
		var size := _input[_position + 1] if head == 2 else _long_size()
		if not _allowed(flags, size):
			return
		if size > available - head:
			if size >= LONG_FRAME_BYTES:
				_begin_long_frame(flags, size, head)
			return
		var body := _input.slice(_position + head, _position + head + size)
		_position += head + size
		_take_frame(flags, body)
		if state != State.HANDSHAKE and state != State.READY:
			return
	_has_whole_frames = true


func _begin_long_frame(flags: int, size: int, head: int) -> void:
	_long = _input.slice(_position + head)
	_long_bytes = size
	_long_flags = flags
	_input.clear()
	_position = 0


## Take the long frame if it is complete. Return whether further frames can be read.
func _read_long_frame() -> bool:
	if _long.size() < _long_bytes:
		return false
	var body := _long
	_forget_long_frame()
	_take_frame(_long_flags, body)
	return state == State.HANDSHAKE or state == State.READY


func _forget_long_frame() -> void:
	_long = PackedByteArray()
	_long_bytes = 0


func _take_frame(flags: int, body: PackedByteArray) -> void:
	if flags & _COMMAND:
		_handle_command(body)
	else:
		_messages.append(body)


func _long_size() -> int:
	var bytes := _input.slice(_position + 1, _position + 9)
	bytes.reverse()
	return bytes.decode_s64(0)


## Return whether a frame is allowed; end the connection if it is not.
func _allowed(flags: int, size: int) -> bool:
	var is_command := flags & _COMMAND
	if flags & ~(_MORE | _LONG | _COMMAND) or (is_command and flags & _MORE):
		_end(State.FAILED, "%s sent a frame with flags %d, which ZMTP does not define." % [_address(), flags])
	elif flags & _MORE:
		_end(State.FAILED, "%s sent a message of several parts; expected messages of one part." % _address())
	elif not is_command and state != State.READY:
		_end(State.FAILED, "%s sent a message before the end of the handshake." % _address())
	elif size < 0 or size > (MAX_COMMAND_BYTES if is_command else max_message_bytes):
		# A size with the highest bit set becomes negative.
		var limit := MAX_COMMAND_BYTES if is_command else max_message_bytes
		_end(State.FAILED, "%s announced a frame of %d bytes; expected at most %d." % [_address(), size, limit])
	else:
		return true
	return false


func _handle_command(body: PackedByteArray) -> void:
	# libzmq 4.3.5 writes 5E "RROR" for 05 "ERROR".
	if state == State.HANDSHAKE and body.slice(0, 5).get_string_from_ascii() == "^RROR":
		_refused(body.slice(5))
		return
	var length := 0 if body.is_empty() else body[0]
	if length == 0 or length >= body.size():
		_end(State.FAILED, "%s sent an incomplete command." % _address())
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
		_end(State.REFUSED, "The service at %s does not accept this token." % _address())
	else:
		_end(State.REFUSED, "The service at %s refused the connection (%s)." % [_address(), code.left(80)])


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


## Return bytes with their length in front of them.
func _short(bytes: PackedByteArray) -> PackedByteArray:
	return PackedByteArray([bytes.size()]) + bytes


func _address() -> String:
	return "%s:%d" % [_host, _port]


func _end(how: State, why: String) -> void:
	state = how
	reason = why
	_lookup = null
	_tcp = null
	_greeted = false
	_has_whole_frames = false
	_input = PackedByteArray()
	_position = 0
	_forget_long_frame()
	_output = PackedByteArray()
