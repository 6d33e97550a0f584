extends "playback.gd"
## The weighted mean of playbacks: of clips, and of a performer.
##
## The controls are mixed as matrices, rotations included, and root motion is mixed with them: each vertex is at the
## weighted mean of its positions.

const Playback := preload("playback.gd")

var _mixed: Array = []  # what the shown mean was computed from


## Show the mean of playbacks by weights greater than 0, which need not add up to 1. Frames of a single one are shown as
## they are. Nothing changes without playbacks.
func mix(playbacks: Array[Playback], weights: PackedFloat64Array) -> void:
	if playbacks.size() == 1:
		earlier = playbacks[0].earlier
		later = playbacks[0].later
		share = playbacks[0].share
		_mixed.clear()
	elif playbacks.size() > 1:
		_show_mean(playbacks, weights)


func _show_mean(playbacks: Array[Playback], weights: PackedFloat64Array) -> void:
	var sum := 0.0
	for weight in weights:
		sum += weight
	var shares: Dictionary = {}  # Message: its share of the mean
	for i in playbacks.size():
		var shown := playbacks[i]
		var own := weights[i] / sum
		shares[shown.earlier] = shares.get(shown.earlier, 0.0) + own * (1.0 - shown.share)
		shares[shown.later] = shares.get(shown.later, 0.0) + own * shown.share
	var inputs := [shares.keys(), shares.values()]
	if inputs == _mixed:
		return
	_mixed = inputs
	earlier = _mean(shares, playbacks[weights.find(Array(weights).max())].earlier)
	later = earlier
	share = 0.0


## Return the mean of frames as a frame like another one.
func _mean(shares: Dictionary, like: Message) -> Message:
	var mean := Message.new()
	mean.topic = like.topic
	mean.kind = like.kind
	mean.user = like.user
	mean.revision = like.revision
	mean.sequence = like.sequence
	mean.time = like.time
	var rows := PackedVector4Array()
	rows.resize(like.payload.size() / 16)
	mean.targets.resize(like.targets.size())
	for frame: Message in shares:
		var own: float = shares[frame]
		mean.root += own * frame.root
		var of_frame := frame.rows()
		for i in rows.size() if own > 0.0 else 0:
			rows[i] += own * of_frame[i]
		for target in mini(mean.targets.size(), frame.targets.size()):
			mean.targets[target] += own * frame.targets[target]
	mean.payload = rows.to_byte_array()
	return mean
