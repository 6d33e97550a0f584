extends RefCounted
## Client of a service's stream. All nodes of this process that use the same address and token share one connection.
##
## It connects, subscribes, passes on messages and reconnects automatically. Each owner calls [method poll] in each
## process frame.

signal state_changed(state: State)

## OFFLINE: not connected; the client keeps retrying. CONNECTING: the first attempt. REFUSED: see [member reason]; the
## client does not retry.
enum State { OFFLINE, CONNECTING, CONNECTED, REFUSED }

const Stream := preload("stream.gd")
const Connection := preload("connection.gd")
const Connections := preload("connections.gd")
const Message := preload("message.gd")

const STATUS := "service/status"
## Time without a message after which the service counts as disconnected, in seconds. It sends its status every second.
const SILENCE_TIMEOUT_SECONDS := 6.0
## Minimum time between two attempts to connect, in seconds. It doubles with each attempt, up to the maximum.
const MIN_RETRY_SECONDS := 0.25
const MAX_RETRY_SECONDS := 2.0
## Maximum number of frames per topic that one poll passes on, the newest ones. A jitter buffer does not keep more.
const MAX_FRAMES := 512
## Minimum time between two requests for the same topic, in seconds.
const REQUEST_INTERVAL_SECONDS := 1.0
## Period in which the shortest transmission time is determined, with which others are compared, in seconds.
const LATENCY_WINDOW_SECONDS := 10.0

static var _streams: Dictionary = {}

var host: String
var port: int
var state := State.OFFLINE
## Why [member state] is OFFLINE or REFUSED.
var reason := ""
## The last message of `service/status` (docs/running.md); empty before the first one.
var last_status: Dictionary = {}

var _connection: Connection
var _followers: Dictionary = {}  # topic: Array[Callable]
var _requested_ms: Dictionary = {}  # topic: milliseconds
var _latest: Dictionary = {}  # topic: the last Message that is not a frame, for later followers
var _new_followers: Array[Array] = []  # [Callable, Message]
var _polled_frame := -1
var _tried := false
var _subscribed := false
var _retry_seconds := MIN_RETRY_SECONDS
var _next_try_ms := 0
var _last_message_ms := 0
var _latency := -1.0
var _shortest_delays := PackedInt64Array([0, 0])  # microseconds, in this window and in the one before
var _window_end_us := 0


func _init(to_host: String, to_port: int, token := "") -> void:
	host = to_host
	port = to_port
	_connection = Connections.make(to_host, "SUB", token)
	follow(STATUS, _take_status)


## Return the stream of a service and a token. It is the same object as long as a reference to it exists.
static func shared(to_host: String, to_port: int, token := "") -> Stream:
	for unused: String in _streams.keys().filter(func(key: String) -> bool: return _streams[key].get_ref() == null):
		_streams.erase(unused)
	var own := "%s:%d %s" % [to_host, to_port, token]
	var stream: Stream = _streams[own].get_ref() if own in _streams else Stream.new(to_host, to_port, token)
	_streams[own] = weakref(stream)
	return stream


## Call a receiver with each [Message] of a topic. If others already follow the topic, the receiver also gets its last
## message, unless that is a frame.
func follow(topic: String, receiver: Callable) -> void:
	if topic not in _followers:
		_followers[topic] = [] as Array[Callable]
		_subscribe(topic)
	if receiver in _followers[topic]:
		return
	_followers[topic].append(receiver)
	if topic in _latest:
		_new_followers.append([receiver, _latest[topic]])


func unfollow(topic: String, receiver: Callable) -> void:
	if topic not in _followers:
		return
	_followers[topic].erase(receiver)
	_new_followers = _new_followers.filter(
		func(each: Array) -> bool: return each[0] != receiver or each[1].topic != topic
	)
	if _followers[topic].is_empty():
		_followers.erase(topic)
		_latest.erase(topic)
		_requested_ms.erase(topic)
		_connection.unsubscribe(topic)


## Request a followed topic again. More than one request per second is ignored.
func ask(topic: String) -> void:
	if (
		topic in _followers
		and Connection.now_ms() >= _requested_ms.get(topic, 0) + int(1000 * REQUEST_INTERVAL_SECONDS)
	):
		_connection.unsubscribe(topic)
		_subscribe(topic)


## Return whether a message has been received in part. On a slow network it may be the requested one.
func is_receiving() -> bool:
	return _connection.is_receiving()


## Connect again at the next [method poll], even if the service has refused the connection.
func retry() -> void:
	_tried = false
	_retry_seconds = MIN_RETRY_SECONDS
	_next_try_ms = 0
	if state == State.REFUSED:
		_change(State.OFFLINE, "")


## Connect, read and pass on messages, at the first call in a process frame.
func poll() -> void:
	if _polled_frame == Engine.get_process_frames():
		return
	_polled_frame = Engine.get_process_frames()
	read()


## Do the same as [method poll] at each call, to wait for a message.
func read() -> void:
	_send_latest()
	_connection.poll()
	match _connection.state:
		Connection.State.CLOSED:
			_connect()
		Connection.State.READY:
			_listen()
		Connection.State.FAILED:
			_handle_messages(_connection.take())
			if _connection.state == Connection.State.FAILED:  # and was not closed because of its version
				_retry_later(_connection.reason)
		Connection.State.REFUSED:
			_refuse(_connection.reason)


## Return the age of the last frame when it arrived, in seconds; negative before the first frame. It is the processing
## time of the service, plus the transmission time beyond the shortest one of the last seconds. The shortest
## transmission time itself is unknown, because the clocks of two processes differ; on one machine it is almost zero.
func same_machine_latency() -> float:
	return _latency


func _connect() -> void:
	if state == State.REFUSED or Connection.now_ms() < _next_try_ms:
		return
	if not _tried:
		_tried = true
		_change(State.CONNECTING, "")
	_subscribed = false
	_connection.open(host, port)


func _listen() -> void:
	var now := Connection.now_ms()
	if not _subscribed:
		_subscribed = true
		_last_message_ms = now
		for topic: String in _followers:
			_subscribe(topic)
	_handle_messages(_connection.take())
	if _connection.is_receiving():
		_last_message_ms = maxi(_last_message_ms, _connection.last_receive_ms)
	if _connection.state == Connection.State.READY and now > _last_message_ms + int(1000 * SILENCE_TIMEOUT_SECONDS):
		var silent := [Connections.address(host, port), SILENCE_TIMEOUT_SECONDS]
		_retry_later("No message from a Puppetline service at %s for %d s." % silent)


func _subscribe(topic: String) -> void:
	_connection.subscribe(topic)
	_requested_ms[topic] = Connection.now_ms()


## Schedule the next attempt, with a longer pause each time.
func _retry_later(why: String) -> void:
	_reset()
	_next_try_ms = Connection.now_ms() + int(1000 * _retry_seconds)
	_retry_seconds = minf(2 * _retry_seconds, MAX_RETRY_SECONDS)
	_change(State.OFFLINE, why)


func _refuse(why: String) -> void:
	_reset()
	_change(State.REFUSED, why)


## Remove what belongs to this run of the service: scenes, users and clocks change when it restarts.
func _reset() -> void:
	_connection.close()
	_latest.clear()
	_new_followers.clear()
	_latency = -1.0
	_window_end_us = 0


func _change(to: State, why: String) -> void:
	reason = why
	if state != to:
		state = to
		state_changed.emit(state)


func _handle_messages(received: Array[PackedByteArray]) -> void:
	for message in _newest(received):
		_last_message_ms = Connection.now_ms()
		if message.major != Message.MAJOR:
			var versions := [message.major, message.minor, Message.MAJOR]
			_refuse(
				(
					"The service uses version %d.%d of the protocol; this addon supports version %d. Update the older one."
					% versions
				)
			)
			return
		_retry_seconds = MIN_RETRY_SECONDS
		_change(State.CONNECTED, "")
		if message.topic in _followers:
			_deliver(message)


## Read messages; skip damaged ones, and those that newer ones of the same topic replace.
func _newest(received: Array[PackedByteArray]) -> Array[Message]:
	var kept: Array[Message] = []
	var counts: Dictionary = {}
	for i in range(received.size() - 1, -1, -1):
		var message := Message.parse(received[i])
		if message == null:
			continue
		var count: int = counts.get(message.topic, 0)
		if count < (MAX_FRAMES if message.is_frame() else 1):
			counts[message.topic] = count + 1
			kept.append(message)
	kept.reverse()
	return kept


func _deliver(message: Message) -> void:
	if message.is_frame():
		_measure_latency(message)
	else:
		_latest[message.topic] = message
	for receiver: Callable in _followers[message.topic].duplicate():
		if not receiver.is_valid():
			unfollow(message.topic, receiver)
		elif _is_following(receiver, message.topic):
			receiver.call(message)


func _send_latest() -> void:
	var new_followers := _new_followers
	_new_followers = []
	for each in new_followers:
		var is_last: bool = _latest.get(each[1].topic) == each[1]  # all followers have already received a newer one
		if is_last and each[0].is_valid() and _is_following(each[0], each[1].topic):
			each[0].call(each[1])


## Return whether a receiver still follows a topic: a receiver that was called before it may have removed it.
func _is_following(receiver: Callable, topic: String) -> bool:
	return receiver in _followers.get(topic, [])


func _take_status(message: Message) -> void:
	var status: Variant = message.json()
	if status is Dictionary:
		last_status = status


func _measure_latency(message: Message) -> void:
	var now := Time.get_ticks_usec()
	var delay := now - message.published / 1000
	if now > _window_end_us:
		# Only two windows count, because clocks drift apart.
		_shortest_delays = PackedInt64Array([delay, _shortest_delays[0] if _window_end_us > 0 else delay])
		_window_end_us = now + int(1e6 * LATENCY_WINDOW_SECONDS)
	_shortest_delays[0] = mini(_shortest_delays[0], delay)
	var excess := delay - mini(_shortest_delays[0], _shortest_delays[1])
	_latency = 1e-9 * (message.published - message.received) + 1e-6 * excess
