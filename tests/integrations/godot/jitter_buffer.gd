extends "teller.gd"
## Adds frames to a jitter buffer and reports the shown frames: a JSON list of {"now", "push": [[sequence, time]...]},
## and the delay in seconds.

const JitterBuffer := preload("res://addons/puppetline/play/jitter_buffer.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")


func start() -> void:
	var buffer := JitterBuffer.new()
	buffer.delay = float(arguments()[1])
	for moment: Dictionary in JSON.parse_string(arguments()[0]):
		for pushed: Array in moment.get("push", []):
			var frame := Message.new()
			frame.sequence = pushed[0]
			frame.time = pushed[1]
			buffer.push(frame, moment["now"])
		var told := {"shows": buffer.advance(moment["now"]), "waiting": buffer.waiting(), "lost": buffer.lost}
		if told["shows"]:
			told.merge({"earlier": buffer.earlier.sequence, "later": buffer.later.sequence, "share": buffer.share})
		tell(told)


func step(_delta: float) -> bool:
	return true
