extends RefCounted
## A connection to a service that sends and receives whole messages. [method poll] does all the work and never blocks.

enum State { CLOSED, CONNECTING, HANDSHAKE, READY, REFUSED, FAILED }

## Maximum duration of connecting and handshake together, in seconds.
const HANDSHAKE_TIMEOUT_SECONDS := 5.0

## Tells the time of all connections, in milliseconds, in place of the system. Tests give one.
static var clock := Callable()

## Maximum size of a message, in bytes. A larger message is refused before it is read.
var max_message_bytes := 256 << 20
var state := State.CLOSED
## Why [member state] is REFUSED or FAILED.
var reason := ""
## Time at which bytes were last received, in milliseconds of [method now_ms].
var last_receive_ms := 0


## Return the time, in milliseconds.
static func now_ms() -> int:
	return clock.call() if clock.is_valid() else Time.get_ticks_msec()


## Begin to connect. A connection that was open before is closed.
func open(_host: String, _port: int) -> void:
	pass


## Connect, read, answer and write as far as that is possible without waiting.
func poll() -> void:
	pass


## Return the received messages. No more are read before these are taken.
func take() -> Array[PackedByteArray]:
	return []


## Return whether a message has been received in part.
func is_receiving() -> bool:
	return false


## Send a message. A message that is sent before [member state] is READY is lost.
func send(_body: PackedByteArray) -> void:
	pass


## Subscribe to exactly this topic.
func subscribe(_topic: String) -> void:
	pass


## Cancel a subscription.
func unsubscribe(_topic: String) -> void:
	pass


func close() -> void:
	pass
