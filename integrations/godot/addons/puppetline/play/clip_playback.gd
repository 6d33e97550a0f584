extends "playback.gd"
## The frames of a clip at a position in it.

var _clip: PuppetClip
var _frames: Dictionary = {}  # number: Message, of the shown frames


func _init(clip: PuppetClip) -> void:
	_clip = clip


## Determine the frames to show at a position in seconds; return false for a clip without frames.
func advance(position: float) -> bool:
	var number := _clip.frame_at(position)
	if number < 0:
		return false
	var next := mini(number + 1, _clip.frame_count() - 1)
	var shown := {number: _frame(number), next: _frame(next)}
	_frames = shown
	earlier = shown[number]
	later = shown[next]
	var start := _clip.frame_position(number)
	var elapsed := _clip.frame_position(next) - start
	share = clampf((position - start) / elapsed, 0.0, 1.0) if number != next else 0.0
	return true


## Return a frame, the same object as long as it is shown.
func _frame(number: int) -> Message:
	return _frames[number] if number in _frames else _clip.frame(number)
