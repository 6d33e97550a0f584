extends RefCounted
## Frames that have come and are not shown yet, so that a picture can be made for each refresh of the display.
##
## Frames come unevenly, and not as often as the display wants pictures. So what is shown lies [member delay] behind
## what comes, between two frames, at the times that the source gave to them. Where nothing comes the last frame stays.

const Message := preload("../wire/message.gd")

## Frames that are kept at most.
const MOST_FRAMES := 64
## Seconds of the source's clock between two frames from which on nothing is shown in between: it is another motion.
const LONGEST_GAP := 0.5
## Seconds over which the frame is sought that was the quickest to come: by it the source's clock is read.
const WINDOW := 1.0
## How much quicker or slower than the source, at most, it is played while its clock drifts.
const SLEW := 0.05
## Seconds that may be caught up with in that way; what is more is jumped over.
const LARGEST_DRIFT := 0.25

## Seconds by which what is shown lies behind what comes.
var delay := 0.05
## The frame before now and the one after; the same one where there is only one; null before the first.
var earlier: Message
var later: Message
## How far it is from [member earlier] to [member later]: 0 to 1.
var share := 0.0
## Frames that were lost on the way, by gaps in their numbers.
var lost := 0

var _frames: Array[Message] = []
var _lag := 0.0  # the local clock minus the source's, as it is played
var _quickest := PackedFloat64Array([INF, INF])  # the same, of the quickest frame: of this window and of the one before
var _window_ends := -INF
var _shown_at := 0.0


## Take a frame in that has come now, in seconds of the local clock.
func push(frame: Message, now: float) -> void:
	if not _follows(frame):
		clear()
	if _frames.is_empty():
		_lag = now - frame.time
		_shown_at = now
	else:
		lost += frame.sequence - _frames[-1].sequence - 1
	_frames.append(frame)
	if _frames.size() > MOST_FRAMES:
		_frames.pop_front()
	_compare_clocks(now - frame.time, now)


## Find out what is to be shown now, in seconds of the local clock; false before the first frame.
func advance(now: float) -> bool:
	if _frames.is_empty():
		return earlier != null
	_follow_clock(now)
	var playhead := now - _lag - delay
	while _frames.size() > 1 and _frames[1].time <= playhead:
		_frames.pop_front()
	earlier = _frames[0]
	later = _frames[1] if _frames.size() > 1 else earlier
	share = clampf(inverse_lerp(earlier.time, later.time, playhead), 0.0, 1.0) if earlier != later else 0.0
	return true


## Forget all but what is shown.
func clear() -> void:
	_frames.clear()
	_quickest.fill(INF)
	_window_ends = -INF


## Return how many frames wait to be shown.
func waiting() -> int:
	return maxi(_frames.size() - 1, 0)


## Tell whether a frame goes on with the motion of the one before.
func _follows(frame: Message) -> bool:
	if _frames.is_empty():
		return false
	var before := _frames[-1]
	var passed := frame.time - before.time
	return frame.sequence > before.sequence and passed > 0.0 and passed <= LONGEST_GAP


func _compare_clocks(difference: float, now: float) -> void:
	if now >= _window_ends:
		_quickest = PackedFloat64Array([INF, _quickest[0]])
		_window_ends = now + WINDOW
	_quickest[0] = minf(_quickest[0], difference)


func _follow_clock(now: float) -> void:
	var aim := minf(_quickest[0], _quickest[1])
	if absf(aim - _lag) > LARGEST_DRIFT:
		_lag = aim
	else:
		_lag = move_toward(_lag, aim, SLEW * (now - _shown_at))
	_shown_at = now
