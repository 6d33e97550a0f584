extends RefCounted
## Chooses the kind of connection to a service.

const Connection := preload("connection.gd")
const ZmtpConnection := preload("zmtp_connection.gd")
const WebSocketConnection := preload("web_socket_connection.gd")


## Return a connection for the stream ("SUB") or for requests ("DEALER"): over WebSocket to an address that begins with
## ws:// or wss://, and in web exports, which have no other sockets; otherwise over TCP.
static func make(host: String, socket_type: String, token: String) -> Connection:
	if OS.has_feature("web") or WebSocketConnection.is_address(host):
		return WebSocketConnection.new(socket_type, token)
	return ZmtpConnection.new(socket_type, token)


## Return the address of a service, as it is written in messages for the user.
static func address(host: String, port: int) -> String:
	return host if WebSocketConnection.is_address(host) else "%s:%d" % [host, port]
