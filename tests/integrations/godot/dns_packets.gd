extends "teller.gd"
## Tells the records of each packet of a file: a length of 4 bytes, so many bytes, and so on; at last a question.

const Dns := preload("res://addons/puppetline/wire/dns.gd")


func _initialize() -> void:
	var file := FileAccess.open(arguments()[0], FileAccess.READ)
	while file.get_position() < file.get_length():
		tell({"records": Dns.parse(file.get_buffer(file.get_32()))})
	tell({"question": base64(Dns.question("_puppetline._tcp.local", Dns.PTR))})
	quit()
