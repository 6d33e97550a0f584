extends "playback.gd"
## Queue of received frames that a clock plays at its own speed. No frame is skipped, however slow the clock is, and the
## last one stays if the clock is faster than the source.

## Maximum size of the waiting frames, in bytes. If there are more, the oldest are skipped.
const MAX_BYTES := 64 << 20
## Approximate size of a frame besides its payload, in bytes.
const FRAME_BYTES := 512
## Relative increase of the playback speed that reduces a lag.
const MAX_RATE_CHANGE := 0.05
## Lag beyond [member delay] that is not reduced, in seconds.
const TOLERATED_LAG_SECONDS := 0.25

## Whether a lag behind the source is reduced by faster playback. It grows while the clock is slower than the source.
var catches_up := false

var _frames: Array[Message] = []
var _times := PackedFloat64Array()  # by frame: position of the playhead at which it is shown
var _bytes := 0
var _playhead := 0.0
var _last_now := NAN


func push(frame: Message, _now: float) -> void:
	var time := _playhead + delay
	if not _frames.is_empty():
		var is_next := continues(_frames[-1], frame)
		lost += frame.sequence - _frames[-1].sequence - 1 if is_next else 0
		# A frame that is late is shown immediately, and those after it are shown later.
		time = maxf(_times[-1] + (frame.time - _frames[-1].time if is_next else 0.0), _playhead)
	_frames.append(frame)
	_times.append(time)
	_bytes += frame.payload.size() + FRAME_BYTES
	while _bytes > MAX_BYTES:
		_drop()
		_playhead = maxf(_playhead, _times[0])


func advance(now: float) -> bool:
	if not is_nan(_last_now) and not _frames.is_empty():
		_playhead = _playhead_at(now)
	_last_now = now
	while _frames.size() > 1 and _times[1] <= _playhead:
		_drop()
	if _frames.is_empty():
		return earlier != null
	earlier = _frames[0]
	later = _frames[1] if _frames.size() > 1 else earlier
	share = clampf(inverse_lerp(_times[0], _times[1], _playhead), 0.0, 1.0) if earlier != later else 0.0
	return true


func waiting() -> int:
	return maxi(_frames.size() - 1, 0)


## Return whether the frames for the time [param now] have arrived.
func reaches(now: float) -> bool:
	return not _frames.is_empty() and _playhead_at(now) <= _times[-1]


func _playhead_at(now: float) -> float:
	var lags := catches_up and _times[-1] - _playhead > delay + TOLERATED_LAG_SECONDS
	return _playhead + (0.0 if is_nan(_last_now) else now - _last_now) * (1.0 + MAX_RATE_CHANGE if lags else 1.0)


func _drop() -> void:
	_bytes -= _frames[0].payload.size() + FRAME_BYTES
	_frames.pop_front()
	_times.remove_at(0)
