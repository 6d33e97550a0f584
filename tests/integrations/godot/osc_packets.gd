extends "teller.gd"
## Reports the contents of each datagram in a file (with a length of 4 bytes before each), and its encoding after
## decoding.

const Osc := preload("res://addons/puppetline/wire/osc.gd")


func start() -> void:
	var file := FileAccess.open(arguments()[0], FileAccess.READ)
	while file.get_position() < file.get_length():
		var messages := Osc.parse(file.get_buffer(file.get_32()))
		var written := messages.map(func(each: Array) -> String: return base64(Osc.encode(each[0], each[1])))
		tell({"messages": messages.map(_named), "written": written})
	quit()


func _named(message: Array) -> Array:
	return [message[0], message[1].map(_typed)]


func _typed(argument: Variant) -> Array:
	if argument is int:
		return ["int", str(argument)]
	if argument is PackedByteArray:
		return ["bytes", base64(argument)]
	return [type_string(typeof(argument)), argument]
