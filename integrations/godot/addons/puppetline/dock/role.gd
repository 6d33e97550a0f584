@tool
extends RefCounted
## How a character is doing, as the service says it (docs/control.md, `describe`; docs/running.md).

const Checked := preload("checked.gd")

const NOBODY := -1
const MOST_USERS := 64

var character := ""
var stage := ""
## "waiting", "calibrating", "performing" or "leaving".
var state := ""
## Who performs, or [constant NOBODY].
var user := NOBODY
## Whom the sensor of its stage sees.
var users := PackedInt32Array()
var mirror := false
## Frames a second.
var rate := 0.0
## Milliseconds from a skeleton's arrival to the network, of 95 in 100; below zero if nothing has come.
var latency := -1.0
## The take that its stage records, empty for none.
var recording := ""


## [param described] is what `describe` says of the character, and [param status] what it says of the service.
func _init(described: Dictionary, status: Dictionary) -> void:
	character = Checked.text(described, "name")
	stage = Checked.text(described, "stage")
	state = Checked.text(described, "state")
	user = int(Checked.number(described, "performer", NOBODY))
	mirror = Checked.flag(described, "mirror")
	rate = Checked.number(_named(status, "characters", character), "rate", 0.0)
	var said := _named(status, "stages", stage)
	recording = Checked.text(said, "recording")
	latency = Checked.number(Checked.table(said, "latency_ms"), "p95", -1.0)
	for each in Checked.tables(said, "users", MOST_USERS):
		users.append(int(Checked.number(each, "user", NOBODY)))


func _named(status: Dictionary, key: String, name: String) -> Dictionary:
	for each in Checked.tables(status, key, Checked.MOST):
		if Checked.text(each, "name") == name:
			return each
	return {}
