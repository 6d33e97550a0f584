extends RefCounted
## The frames to show at a time. Base of the jitter buffer, which keeps up with the source, and of the frame queue,
## which follows another clock.

const Message := preload("../wire/message.gd")

## Maximum time between two consecutive frames, in seconds of the source's clock. After a longer gap, a new motion
## begins without interpolation.
const MAX_GAP_SECONDS := 0.5

## Time by which the shown pose lags behind the received frames, in seconds.
var delay := 0.05
## The frames before and after the shown time; the same frame if there is only one; null before the first.
var earlier: Message
var later: Message
## Position of the shown time between [member earlier] (0) and [member later] (1).
var share := 0.0
## Number of frames that were lost in transmission, from gaps in their numbers.
var lost := 0


## Add a frame that arrived at the time [param now], in seconds of the clock.
func push(_frame: Message, _now: float) -> void:
	pass


## Determine the frames to show at the time [param now], in seconds of the clock; return false before the first.
func advance(_now: float) -> bool:
	return false


## Return the number of frames that have not been shown yet.
func waiting() -> int:
	return 0


## Return whether a frame continues the motion of the previous one.
static func continues(before: Message, frame: Message) -> bool:
	var elapsed := frame.time - before.time
	return frame.sequence > before.sequence and elapsed > 0.0 and elapsed <= MAX_GAP_SECONDS
