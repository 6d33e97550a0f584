extends RefCounted
## The clips of a [Puppet3D]: one that plays automatically, and those that animations mix.

const SharedScene := preload("shared_scene.gd")
const Playback := preload("playback.gd")
const ClipPlayback := preload("clip_playback.gd")

## Smallest weight with which a clip is shown.
const _MIN_WEIGHT := 1e-6

## By mixed clip: the product of its position in seconds and its weight, and its weight. Animations are blended as sums,
## so both are kept as products with the weight.
var mix: Array[Vector2] = []
## Whether there are clips, usable or not.
var is_used := false
## Description of an error for the user; empty if there is none.
var problem := ""
## The clips that are shown after [method advance], and their weights.
var shown: Array[Playback] = []
var weights := PackedFloat64Array()

var _clips: Array[PuppetClip] = []  # the one that plays automatically, then the mixed ones; all are of one scene
var _playbacks: Array[ClipPlayback] = []  # by clip; null for no clip


## Set the clip that plays automatically, and the mixed ones. Damaged ones, and those of another scene, are omitted.
func set_clips(clip: PuppetClip, mixed: Array[PuppetClip]) -> void:
	problem = ""
	_clips.clear()
	_playbacks.clear()
	is_used = false
	resize(mixed.size())
	for each: PuppetClip in [clip] + mixed:
		is_used = is_used or each != null
		var obstacle := _obstacle(each) if each != null else ""
		problem = obstacle if obstacle else problem
		_clips.append(each if obstacle.is_empty() else null)
		_playbacks.append(ClipPlayback.new(each) if _clips[-1] != null else null)


## Set the number of mixed clips, before they are loaded.
func resize(count: int) -> void:
	while mix.size() < count:
		mix.append(Vector2.ZERO)
	mix.resize(count)


## Return the first usable clip; null if there is none.
func first() -> PuppetClip:
	for each in _clips:
		if each != null:
			return each
	return null


## Determine the frames to show. The clip that plays automatically is at a position in seconds, and its weight is 1
## minus those of the others. If no clip has a weight, the first usable mixed one is shown at its beginning.
func advance(position: float) -> void:
	shown.clear()
	weights.clear()
	var rest := 1.0
	for i in mix.size():
		rest -= _show(1 + i, mix[i].x / mix[i].y, mix[i].y) if mix[i].y > _MIN_WEIGHT else 0.0
	if rest > _MIN_WEIGHT:
		_show(0, position, rest)
	for i in mix.size() if shown.is_empty() else 0:
		if shown.is_empty():
			_show(1 + i, 0.0, 1.0)


## Show a clip at a position with a weight; return the weight, or 0 if the clip is missing, unusable or not loaded yet.
func _show(number: int, position: float, weight: float) -> float:
	if number >= _playbacks.size() or _playbacks[number] == null or not _playbacks[number].advance(position):
		return 0.0
	shown.append(_playbacks[number])
	weights.append(weight)
	return weight


## Return why a clip cannot be shown with those before it; empty if it can.
func _obstacle(clip: PuppetClip) -> String:
	if clip.problem():
		return "The clip is damaged: %s. Write it again with `puppetline clip`." % clip.problem()
	if first() != null and clip.revision() != first().revision():
		return "The clips are of different characters, or of different versions of one. Write them again."
	return ""
