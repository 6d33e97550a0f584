extends RefCounted
## The frames that have arrived for a character, and the clock that determines when they are shown.

const Message := preload("../wire/message.gd")
const Playback := preload("playback.gd")
const JitterBuffer := preload("jitter_buffer.gd")
const FrameQueue := preload("frame_queue.gd")

## Maximum number of frames from which the frame rate is measured.
const _MAX_ARRIVALS := 256
## Maximum time for which an image of a movie waits for its first frame, and for one of the next frames, in seconds.
const _FIRST_FRAME_TIMEOUT_SECONDS := 20.0
const _NEXT_FRAME_TIMEOUT_SECONDS := 2.0

## The frames to show.
var playback: Playback
## Number of frames of the wrong size.
var damaged := 0
## Delay of the frames, in seconds.
var delay := 0.0:
	set(value):
		delay = value
		playback.delay = value

var _is_real_time := true
var _time := 0.0  # of a clock other than the machine's, in seconds
var _waits := true  # whether a movie waits for frames
var _arrivals := PackedFloat64Array()


func _init() -> void:
	clear()


## Set whether the clock is the machine's. In real time, frames arrive irregularly, and late ones are skipped; another
## clock moves by [method advance_clock], and skips none.
func set_clock(is_real_time: bool) -> void:
	_is_real_time = is_real_time
	clear()


## Remove all frames.
func clear() -> void:
	playback = JitterBuffer.new() if _is_real_time else FrameQueue.new()
	playback.delay = delay


## Move a clock other than the machine's on, by a time in seconds.
func advance_clock(seconds: float, catches_up: bool) -> void:
	_time += seconds
	(playback as FrameQueue).catches_up = catches_up


## Add a frame with a payload of the expected size in bytes; return whether it has that size.
func push(message: Message, size: int) -> bool:
	if message.payload.size() != size:
		damaged += 1
		return false
	_arrivals = _arrivals.slice(-_MAX_ARRIVALS) if _arrivals.size() > 2 * _MAX_ARRIVALS else _arrivals
	_arrivals.append(_real_time())
	_waits = true
	playback.push(message, _now())
	return true


## Determine the frames to show now; return false before the first.
func advance() -> bool:
	return playback.advance(_now())


## Wait until the frames of this image of a movie have arrived: movies are written faster or slower than real time.
## [param read] reads what has arrived, and returns false if there is no stream.
func wait_for_movie(read: Callable) -> void:
	var limit := _FIRST_FRAME_TIMEOUT_SECONDS if playback.earlier == null else _NEXT_FRAME_TIMEOUT_SECONDS
	var give_up := Time.get_ticks_msec() + int(1000 * limit)
	while _waits and not (playback as FrameQueue).reaches(_time) and read.call():
		if Time.get_ticks_msec() > give_up:
			_waits = false  # until a frame arrives
			push_warning(
				"Puppetline: no frame for the movie within %d s. Check that the service is sending frames." % limit
			)
		OS.delay_msec(1)


## Return the number of frames that have arrived within the last second.
func per_second() -> int:
	_arrivals = _arrivals.slice(_arrivals.bsearch(_real_time() - 1.0))
	return _arrivals.size()


## Return the time of the clock in seconds.
func _now() -> float:
	return _real_time() if _is_real_time else _time


static func _real_time() -> float:
	return Time.get_ticks_usec() * 1e-6
