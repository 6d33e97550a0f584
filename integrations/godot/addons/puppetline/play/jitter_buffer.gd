extends "playback.gd"
## Buffer of received frames, from which each refresh of the display gets an interpolated pose.
##
## Frames arrive at irregular times, and at another rate than the display's. They are therefore shown with a [member
## delay], interpolated by the source's times. If no frames arrive, the last one stays.

## Maximum number of frames in the buffer: the longest delay, one second, of a source with 500 frames per second.
const MAX_FRAMES := 512
## Period in which the frame with the shortest transmission time is determined, in seconds. It defines the offset of the
## source's clock.
const WINDOW_SECONDS := 1.0
## Maximum relative change of the playback speed that corrects clock drift.
const MAX_RATE_CHANGE := 0.05
## Maximum drift that the speed corrects, in seconds; playback skips larger differences.
const MAX_GRADUAL_DRIFT_SECONDS := 0.25

var _frames: Array[Message] = []
var _lag := 0.0  # local clock minus source's clock, as used for playback
var _smallest_lags := PackedFloat64Array([INF, INF])  # of all frames in this window, and in the one before
var _window_end := -INF
var _last_advance := 0.0


## Add a frame that arrived at the time [param now], in seconds of the local clock.
func push(frame: Message, now: float) -> void:
	if not _frames.is_empty() and not continues(_frames[-1], frame):
		clear()
	if _frames.is_empty():
		_lag = now - frame.time
		_last_advance = now
	else:
		lost += frame.sequence - _frames[-1].sequence - 1
	_frames.append(frame)
	if _frames.size() > MAX_FRAMES:
		_frames.pop_front()
	_record_lag(now - frame.time, now)


## Determine the frames to show at the time [param now], in seconds of the local clock; return false before the first.
func advance(now: float) -> bool:
	if _frames.is_empty():
		return earlier != null
	_adjust_lag(now)
	var playhead := now - _lag - delay
	while _frames.size() > 1 and _frames[1].time <= playhead:
		_frames.pop_front()
	earlier = _frames[0]
	later = _frames[1] if _frames.size() > 1 else earlier
	share = clampf(inverse_lerp(earlier.time, later.time, playhead), 0.0, 1.0) if earlier != later else 0.0
	return true


## Remove all frames; the shown ones stay in [member earlier] and [member later].
func clear() -> void:
	_frames.clear()
	_smallest_lags.fill(INF)
	_window_end = -INF


## Return the number of frames that have not been shown yet.
func waiting() -> int:
	return maxi(_frames.size() - 1, 0)


func _record_lag(difference: float, now: float) -> void:
	if now >= _window_end:
		_smallest_lags = PackedFloat64Array([INF, _smallest_lags[0]])
		_window_end = now + WINDOW_SECONDS
	_smallest_lags[0] = minf(_smallest_lags[0], difference)


func _adjust_lag(now: float) -> void:
	var target := minf(_smallest_lags[0], _smallest_lags[1])
	if absf(target - _lag) > MAX_GRADUAL_DRIFT_SECONDS:
		_lag = target
	else:
		_lag = move_toward(_lag, target, MAX_RATE_CHANGE * (now - _last_advance))
	_last_advance = now
