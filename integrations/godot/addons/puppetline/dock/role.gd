@tool
extends RefCounted
## How a character is doing, as the service says it (docs/control.md, `describe`; docs/running.md).

const Checked := preload("checked.gd")
const Role := preload("role.gd")

const NOBODY := -1
const MOST_CHARACTERS := 256
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


## Read the result of the command `describe`: the characters in their order.
static func read_all(result: Variant) -> Array[Role]:
	var all: Array[Role] = []
	var status := Checked.table(result, "status")
	for each in Checked.tables(result, "characters", MOST_CHARACTERS):
		var role := Role.new()
		role.character = Checked.text(each, "name")
		role.stage = Checked.text(each, "stage")
		role.state = Checked.text(each, "state")
		role.user = int(Checked.number(each, "performer", NOBODY))
		role.mirror = Checked.flag(each, "mirror")
		var figures := _named(status, "characters", role.character)
		role.rate = Checked.number(figures, "rate", 0.0)
		role._read_stage(_named(status, "stages", role.stage))
		all.append(role)
	return all


func _read_stage(said: Dictionary) -> void:
	recording = Checked.text(said, "recording")
	latency = Checked.number(Checked.table(said, "latency_ms"), "p95", -1.0)
	for each in Checked.tables(said, "users", MOST_USERS):
		users.append(int(Checked.number(each, "user", NOBODY)))


static func _named(status: Dictionary, key: String, name: String) -> Dictionary:
	for each in Checked.tables(status, key, MOST_CHARACTERS):
		if Checked.text(each, "name") == name:
			return each
	return {}
