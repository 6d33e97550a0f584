extends "teller.gd"
## Gives frames to a jitter buffer, and reports what it shows: a JSON list of [moment, number, time of the source] of
## frames and of [moment] of looks, and the delay in seconds.

const JitterBuffer := preload("res://addons/puppetline/play/jitter_buffer.gd")
const Message := preload("res://addons/puppetline/wire/message.gd")


func start() -> void:
	var buffer := JitterBuffer.new()
	buffer.delay = float(arguments()[1])
	for step: Array in JSON.parse_string(arguments()[0]):
		if step.size() > 1:
			var frame := Message.new()
			frame.sequence = step[1]
			frame.time = step[2]
			buffer.push(frame, step[0])
		elif buffer.advance(step[0]):
			var time := lerpf(buffer.earlier.time, buffer.later.time, buffer.share)
			tell({"time": time, "waiting": buffer.waiting(), "lost": buffer.lost})
		else:
			tell({"time": null, "waiting": buffer.waiting(), "lost": buffer.lost})
	quit()
