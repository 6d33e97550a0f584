@tool
extends RefCounted
## The state of a character as reported by the service (docs/control.md, `describe`; docs/running.md).

const Checked := preload("checked.gd")

const NO_USER := -1
const MAX_USERS := 64

var name := ""
var stage := ""
## "waiting", "calibrating", "performing" or "leaving".
var state := ""
## User number of the performer, or [constant NO_USER].
var user := NO_USER
## User numbers of all performers on its stage.
var users := PackedInt32Array()
var mirror := false
## Frames per second.
var rate := 0.0
## 95th percentile of the time from the arrival of a skeleton to the sending of the frame, in milliseconds; negative
## before the first frame.
var latency := -1.0
## Name of the take that its stage records; empty for none.
var recording := ""


## [param described] is the character in the result of `describe`, and [param status] the status of the service in it.
func _init(described: Dictionary, status: Dictionary) -> void:
	name = Checked.text(described, "name")
	stage = Checked.text(described, "stage")
	state = Checked.text(described, "state")
	user = int(Checked.number(described, "performer", NO_USER))
	mirror = Checked.flag(described, "mirror")
	rate = Checked.number(_named(status, "characters", name), "rate", 0.0)
	var stage_status := _named(status, "stages", stage)
	recording = Checked.text(stage_status, "recording")
	latency = Checked.number(Checked.table(stage_status, "latency_ms"), "p95", -1.0)
	for each in Checked.tables(stage_status, "users", MAX_USERS):
		users.append(int(Checked.number(each, "user", NO_USER)))


func _named(status: Dictionary, key: String, wanted: String) -> Dictionary:
	for each in Checked.tables(status, key, Checked.MAX_ITEMS):
		if Checked.text(each, "name") == wanted:
			return each
	return {}
