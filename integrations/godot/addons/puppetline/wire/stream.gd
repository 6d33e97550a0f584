extends RefCounted
## A service that is followed: one connection for everybody in this process who follows it, with the same token.
##
## It connects, subscribes, hands out messages and comes back by itself. Whoever holds it calls [method poll] in each
## process frame.

signal state_changed(state: State)

## OFFLINE: nobody is there, and it is tried again and again. CONNECTING: the first try. REFUSED: see [member reason];
## it is not tried again.
enum State { OFFLINE, CONNECTING, CONNECTED, REFUSED }

const Stream := preload("stream.gd")
const Connection := preload("zmtp_connection.gd")
const Message := preload("message.gd")

const STATUS := "service/status"
## Seconds without a word after which the service is taken for gone: it sends its status each second.
const SILENCE := 6.0
## Seconds between two tries, at first and at last.
const SHORTEST_WAIT := 0.25
const LONGEST_WAIT := 2.0
## Frames of one topic that are handed out in one poll, the newest; a jitter buffer has no use for more.
const MOST_FRAMES := 64
## Seconds between two questions for the same.
const ASK_INTERVAL := 1.0
## Seconds over which the quickest message is sought that others are compared with.
const LATENCY_WINDOW := 10.0

static var _streams: Dictionary = {}

var host: String
var port: int
var state := State.OFFLINE
## Why [member state] is OFFLINE or REFUSED.
var reason := ""
## What `service/status` said last, empty before (docs/running.md).
var last_status: Dictionary = {}

var _connection: Connection
var _followers: Dictionary = {}  # topic: Array[Callable]
var _asked: Dictionary = {}  # topic: milliseconds
var _latest: Dictionary = {}  # topic: the last Message that is no frame, for those who follow later
var _newcomers: Array[Array] = []  # [Callable, Message]
var _polled := -1
var _tried := false
var _subscribed := false
var _wait := SHORTEST_WAIT
var _try_at := 0
var _heard_at := 0
var _latency := -1.0
var _quickest := PackedInt64Array([0, 0])  # microseconds: of this window and of the one before
var _window_ends := 0


func _init(to_host: String, to_port: int, token := "") -> void:
	host = to_host
	port = to_port
	_connection = Connection.new("SUB", token)
	follow(STATUS, _take_status)


## Return the stream of a service and a token: the same one as long as anybody holds it.
static func shared(to_host: String, to_port: int, token := "") -> Stream:
	for unused: String in _streams.keys().filter(func(key: String) -> bool: return _streams[key].get_ref() == null):
		_streams.erase(unused)
	var own := "%s:%d %s" % [to_host, to_port, token]
	var stream: Stream = _streams[own].get_ref() if own in _streams else Stream.new(to_host, to_port, token)
	_streams[own] = weakref(stream)
	return stream


## Have a receiver called with each [Message] of a topic. Who follows a topic that others follow already is given the
## last message of it that is no frame.
func follow(topic: String, receiver: Callable) -> void:
	if topic not in _followers:
		_followers[topic] = [] as Array[Callable]
		_subscribe(topic)
	if receiver in _followers[topic]:
		return
	_followers[topic].append(receiver)
	if topic in _latest:
		_newcomers.append([receiver, _latest[topic]])


func unfollow(topic: String, receiver: Callable) -> void:
	if topic not in _followers:
		return
	_followers[topic].erase(receiver)
	_newcomers = _newcomers.filter(func(each: Array) -> bool: return each[0] != receiver or each[1].topic != topic)
	if _followers[topic].is_empty():
		_followers.erase(topic)
		_latest.erase(topic)
		_asked.erase(topic)
		_connection.unsubscribe(topic)


## Ask anew for a topic that is followed, at most once a second: what comes more often is ignored.
func ask(topic: String) -> void:
	if topic in _followers and Time.get_ticks_msec() >= _asked.get(topic, 0) + int(1000 * ASK_INTERVAL):
		_connection.unsubscribe(topic)
		_subscribe(topic)


## Tell whether a message has come in part: on a slow line it may be the one that is waited for.
func is_receiving() -> bool:
	return _connection.is_receiving()


## Try again at once, even where the service has refused.
func retry() -> void:
	_tried = false
	_wait = SHORTEST_WAIT
	_try_at = 0
	if state == State.REFUSED:
		_change(State.OFFLINE, "")


## Do what there is to do now, at the first call in a process frame.
func poll() -> void:
	if _polled == Engine.get_process_frames():
		return
	_polled = Engine.get_process_frames()
	_welcome()
	_connection.poll()
	match _connection.state:
		Connection.State.CLOSED:
			_try()
		Connection.State.READY:
			_listen()
		Connection.State.FAILED:
			_hand_out(_connection.take())
			if _connection.state == Connection.State.FAILED:  # and has not been given up as another version's
				_lose(_connection.reason)
		Connection.State.REFUSED:
			_refuse(_connection.reason)


## Return how old the last frame was when it came, in seconds; below zero if none has come. That is the time it took
## the service, and how much longer its way was than that of the quickest frame lately. What every frame needs for its
## way cannot be seen, because the clocks of two processes do not start together; on one machine it is next to nothing.
func same_machine_latency() -> float:
	return _latency


func _try() -> void:
	if state == State.REFUSED or Time.get_ticks_msec() < _try_at:
		return
	if not _tried:
		_tried = true
		_change(State.CONNECTING, "")
	_subscribed = false
	_connection.open(host, port)


func _listen() -> void:
	var now := Time.get_ticks_msec()
	if not _subscribed:
		_subscribed = true
		_heard_at = now
		for topic: String in _followers:
			_subscribe(topic)
	_hand_out(_connection.take())
	if _connection.is_receiving():
		_heard_at = maxi(_heard_at, _connection.heard_at)
	if _connection.state == Connection.State.READY and now > _heard_at + int(1000 * SILENCE):
		_lose("No message of a Puppetline service has come from %s:%d for %d s." % [host, port, SILENCE])


func _subscribe(topic: String) -> void:
	_connection.subscribe(topic)
	_asked[topic] = Time.get_ticks_msec()


## Wait before the next try, longer from time to time.
func _lose(why: String) -> void:
	_forget()
	_try_at = Time.get_ticks_msec() + int(1000 * _wait)
	_wait = minf(2 * _wait, LONGEST_WAIT)
	_change(State.OFFLINE, why)


func _refuse(why: String) -> void:
	_forget()
	_change(State.REFUSED, why)


## Another run of the service has other scenes, users and clocks.
func _forget() -> void:
	_connection.close()
	_latest.clear()
	_newcomers.clear()
	_latency = -1.0
	_window_ends = 0


func _change(to: State, why: String) -> void:
	reason = why
	if state != to:
		state = to
		state_changed.emit(state)


func _hand_out(come: Array[PackedByteArray]) -> void:
	for message in _newest(come):
		_heard_at = Time.get_ticks_msec()
		if message.major != Message.MAJOR:
			var versions := [message.major, message.minor, Message.MAJOR]
			_refuse(
				"The service speaks version %d.%d of the protocol, and this addon %d. Update the older one." % versions
			)
			return
		_wait = SHORTEST_WAIT
		_change(State.CONNECTED, "")
		if message.topic in _followers:
			_give(message)


## Read messages and leave out those that newer ones of their topic make useless; damaged ones are as good as none.
func _newest(come: Array[PackedByteArray]) -> Array[Message]:
	var kept: Array[Message] = []
	var counts: Dictionary = {}
	for i in range(come.size() - 1, -1, -1):
		var message := Message.parse(come[i])
		if message == null:
			continue
		var count: int = counts.get(message.topic, 0)
		if count < (MOST_FRAMES if message.is_frame() else 1):
			counts[message.topic] = count + 1
			kept.append(message)
	kept.reverse()
	return kept


func _give(message: Message) -> void:
	if message.is_frame():
		_measure(message)
	else:
		_latest[message.topic] = message
	for receiver: Callable in _followers[message.topic].duplicate():
		if not receiver.is_valid():
			unfollow(message.topic, receiver)
		elif _is_following(receiver, message.topic):
			receiver.call(message)


func _welcome() -> void:
	var newcomers := _newcomers
	_newcomers = []
	for each in newcomers:
		var is_last: bool = _latest.get(each[1].topic) == each[1]  # a newer one has been given to all
		if is_last and each[0].is_valid() and _is_following(each[0], each[1].topic):
			each[0].call(each[1])


## Tell whether a receiver has not been sent away, by one that was called before it say.
func _is_following(receiver: Callable, topic: String) -> bool:
	return receiver in _followers.get(topic, [])


func _take_status(message: Message) -> void:
	var status: Variant = message.json()
	if status is Dictionary:
		last_status = status


func _measure(message: Message) -> void:
	var now := Time.get_ticks_usec()
	var way := now - message.published / 1000
	if now > _window_ends:
		# Of a window and the one before it, so that clocks may drift apart.
		_quickest = PackedInt64Array([way, _quickest[0] if _window_ends > 0 else way])
		_window_ends = now + int(1e6 * LATENCY_WINDOW)
	_quickest[0] = mini(_quickest[0], way)
	var longer := way - mini(_quickest[0], _quickest[1])
	_latency = 1e-9 * (message.published - message.received) + 1e-6 * longer
