extends "connection.gd"
## A connection over WebSocket for the stream ("SUB") or for requests ("DEALER"), see "WebSocket" in docs/protocol.md.
##
## A host that begins with ws:// or wss:// is the whole address, with port and path. For any other host, the port is the
## service's default: the second one after that of the stream.

## Size of the buffer of received messages, in bytes. It is the maximum size of a message; a scene takes about 150 bytes
## per vertex.
const INPUT_BUFFER_BYTES := 1 << 25
const PATH := "/stream"
## Close code of a wrong token.
const WRONG_TOKEN := 4401
## Difference between the port of the WebSocket and the port of the socket, by socket type.
const _PORTS_UP := {"SUB": 2, "DEALER": 1}

var _socket_type: String
var _token: String
var _url := ""
var _peer: WebSocketPeer
var _deadline_ms := 0
var _messages: Array[PackedByteArray] = []


## Return whether a host is an address of a WebSocket.
static func is_address(host: String) -> bool:
	return host.begins_with("ws://") or host.begins_with("wss://")


## [param socket_type] is "SUB" or "DEALER".
func _init(socket_type: String, token := "") -> void:
	_socket_type = socket_type
	_token = token


func open(host: String, port: int) -> void:
	close()
	var name := "[%s]" % host if ":" in host else host
	_url = host if is_address(host) else "ws://%s:%d%s" % [name, port + _PORTS_UP[_socket_type], PATH]
	_deadline_ms = now_ms() + int(1000 * HANDSHAKE_TIMEOUT_SECONDS)
	_peer = WebSocketPeer.new()
	_peer.inbound_buffer_size = mini(max_message_bytes, INPUT_BUFFER_BYTES)
	state = State.CONNECTING
	# A closed port is expected here, and each retry would otherwise make the engine print an error.
	var printing := Engine.print_error_messages
	Engine.print_error_messages = false
	var error := _peer.connect_to_url(_url)
	Engine.print_error_messages = printing
	if error != OK:
		_end(State.FAILED, "%s is not an address; expected ws://HOST:PORT%s." % [_url, PATH])


func poll() -> void:
	if _peer == null:
		return
	_peer.poll()
	match _peer.get_ready_state():
		WebSocketPeer.STATE_OPEN:
			_exchange()
		WebSocketPeer.STATE_CLOSED:
			_receive()
			_end_by_peer()
		_:
			if now_ms() > _deadline_ms:
				_end(State.FAILED, "No answer from %s within %d s." % [_url, HANDSHAKE_TIMEOUT_SECONDS])


func take() -> Array[PackedByteArray]:
	var taken := _messages
	_messages = []
	return taken


func send(body: PackedByteArray) -> void:
	if state == State.READY:
		_peer.send_text(body.get_string_from_utf8())


func subscribe(topic: String) -> void:
	send(JSON.stringify({"subscribe": topic}).to_utf8_buffer())


func unsubscribe(topic: String) -> void:
	send(JSON.stringify({"unsubscribe": topic}).to_utf8_buffer())


func close() -> void:
	if _peer != null:
		_peer.close()
	_end(State.CLOSED, "")
	_messages = []


func _exchange() -> void:
	if state == State.CONNECTING:
		state = State.READY
		_peer.send_text(JSON.stringify({} if _token.is_empty() else {"token": _token}))
	if _messages.is_empty():
		_receive()


## Keep the received messages: binary ones of the stream, and text ones, which are the replies to requests.
func _receive() -> void:
	while _peer.get_available_packet_count() > 0:
		var packet := _peer.get_packet()
		last_receive_ms = now_ms()
		if _peer.was_string_packet() == (_socket_type == "DEALER"):
			_messages.append(packet)


func _end_by_peer() -> void:
	if _peer.get_close_code() == WRONG_TOKEN and _token.is_empty():
		_end(State.REFUSED, "The service at %s requires a token, and none is set." % _url)
	elif _peer.get_close_code() == WRONG_TOKEN:
		_end(State.REFUSED, "The service at %s does not accept this token." % _url)
	elif state == State.READY:
		_end(State.FAILED, "%s has closed the connection." % _url)
	else:
		_end(State.FAILED, "Cannot connect to %s. Check that the service runs with --websocket." % _url)


func _end(how: State, why: String) -> void:
	state = how
	reason = why
	_peer = null
