@tool
extends RefCounted
## Values out of a reply, which may hold anything: what is missing or of another type is empty.

## Items of a list, where nothing else limits it.
const MOST := 256


static func table(from: Variant, key: String) -> Dictionary:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is Dictionary else {}


static func tables(from: Variant, key: String, most: int) -> Array[Dictionary]:
	var found: Array[Dictionary] = []
	for each: Variant in _list(from, key, most):
		if each is Dictionary:
			found.append(each)
	return found


static func text(from: Variant, key: String) -> String:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is String else ""


static func texts(from: Variant, key: String, most: int) -> PackedStringArray:
	var found := PackedStringArray()
	for each: Variant in _list(from, key, most):
		if each is String:
			found.append(each)
	return found


## A number, or [param otherwise] where there is none.
static func number(from: Variant, key: String, otherwise: float) -> float:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is float and is_finite(value) else otherwise


static func flag(from: Variant, key: String) -> bool:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value if value is bool else false


static func _list(from: Variant, key: String, most: int) -> Array:
	var value: Variant = from.get(key) if from is Dictionary else null
	return value.slice(0, most) if value is Array else []
