extends RefCounted
## The takes that the service records of a character's stage, and what has changed.

## Emitted when the service has started to record a take.
signal started(take: String)
## Emitted when the service has finished a take.
signal stopped(take: String)

var _takes: Array[String] = []


## Take notice of a status of the service (docs/running.md).
func notice(status: Dictionary, character: String) -> void:
	_change(_takes_of_stage(status, character))


## Take notice of the end of the connection.
func clear() -> void:
	_change([])


## Return the takes that are recorded of the character's stage; of all stages if an older service does not report which
## one that is.
static func _takes_of_stage(status: Dictionary, character: String) -> Array[String]:
	var own: Variant = null
	for each: Variant in status["characters"] if status.get("characters") is Array else []:
		if each is Dictionary and each.get("name") is String and each["name"] == character:
			own = each.get("stage")
	var takes: Array[String] = []
	for stage: Variant in status["stages"] if status.get("stages") is Array else []:
		if (
			stage is Dictionary
			and stage.get("recording") is String
			and (own == null or is_same(stage.get("name"), own))
		):
			takes.append(stage["recording"])
	return takes


func _change(takes: Array[String]) -> void:
	var before := _takes
	_takes = takes
	for take in before:
		if take not in takes:
			stopped.emit(take)
	for take in takes:
		if take not in before:
			started.emit(take)
