extends "playback.gd"
## The frames of a clip at a position in it.

var _clip: PuppetClip
var _frames: Dictionary = {}  # number: Message, of the shown frames


func _init(clip: PuppetClip) -> void:
	_clip = clip


## Determine the frames to show at a position in seconds; return false for a clip without frames.
func advance(position: float) -> bool:
	var last := _clip.frame_count() - 1
	if last < 0:
		return false
	var place := clampf(position * _clip.frames_per_second(), 0.0, last)
	var number := mini(int(place), maxi(last - 1, 0))
	var next := mini(number + 1, last)
	var shown := {number: _frame(number), next: _frame(next)}
	_frames = shown
	earlier = shown[number]
	later = shown[next]
	share = place - number if number != next else 0.0
	return true


## Return a frame, the same object as long as it is shown.
func _frame(number: int) -> Message:
	return _frames[number] if number in _frames else _clip.frame(number)
