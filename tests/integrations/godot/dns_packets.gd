extends "teller.gd"
## Reports the records of each packet in a file, which contains a length of 4 bytes before each packet, and then a
## query.

const Dns := preload("res://addons/puppetline/wire/dns.gd")


func start() -> void:
	var file := FileAccess.open(arguments()[0], FileAccess.READ)
	while file.get_position() < file.get_length():
		tell({"records": Dns.parse(file.get_buffer(file.get_32()))})
	tell({"question": base64(Dns.question("_puppetline._tcp.local", Dns.PTR))})
	quit()
