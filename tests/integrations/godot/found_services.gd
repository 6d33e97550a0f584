extends "teller.gd"
## Reports the services that the packets of a file announce (with a length of 4 bytes before each packet), and how many
## are still stored after their timeout.

const Discovery := preload("res://addons/puppetline/wire/discovery.gd")
const Dns := preload("res://addons/puppetline/wire/dns.gd")


func start() -> void:
	var discovery := Discovery.new()
	discovery._next_query_ms = 1 << 60  # no queries are sent to the network
	var file := FileAccess.open(arguments()[0], FileAccess.READ)
	while file.get_position() < file.get_length():
		discovery._add_services(Dns.parse(file.get_buffer(file.get_32())), "10.0.0.7")
	tell({"services": discovery.services})
	for name: String in discovery._last_answer_ms:
		discovery._last_answer_ms[name] = -1_000_000
	discovery.poll()
	tell({"services": discovery.services, "remembered": discovery._last_answer_ms.size()})
	quit()
