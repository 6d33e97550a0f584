extends "teller.gd"
## Discovers services and reports them on each change.

const Discovery := preload("res://addons/puppetline/wire/discovery.gd")

var _discovery := Discovery.new()


func start() -> void:
	_discovery.changed.connect(_tell_services)


func step(_delta: float) -> bool:
	_discovery.poll()
	if is_over():
		_discovery.changed.disconnect(_tell_services)
	return is_over()


func _tell_services() -> void:
	tell({"services": _discovery.services})
