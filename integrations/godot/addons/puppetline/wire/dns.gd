extends RefCounted
## DNS messages, as much of them as looking for a service needs, read within bounds.

const Texts := preload("texts.gd")

const A := 1
const PTR := 12
const TXT := 16
const SRV := 33

const MOST_RECORDS := 512
## Labels of a name; 127 fit into the 255 bytes that it may have.
const MOST_LABELS := 127

const _INTERNET := 1
const _HEADER := 12
const _ANSWER := 0x8000


## Write a question.
static func question(name: String, type: int) -> PackedByteArray:
	var packet := PackedByteArray([0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0])
	for label in name.split("."):
		packet.append(label.length())
		packet.append_array(label.to_utf8_buffer())
	packet.append_array([0, 0, type, 0, _INTERNET])
	return packet


## Read the records of an answer, those of the types above: dictionaries of `name`, `type` and `data`, which is a String
## for PTR and A, a PackedStringArray for TXT, and `{"port", "target"}` for SRV. What comes after damage is left out;
## texts that are no UTF-8 are empty.
static func parse(packet: PackedByteArray) -> Array[Dictionary]:
	var records: Array[Dictionary] = []
	if packet.size() < _HEADER or not _u16(packet, 2) & _ANSWER:
		return records
	var at := _HEADER
	for _i in _u16(packet, 4):
		at = _name(packet, at)[1] + 4
		if at > packet.size():
			return records
	for _i in mini(_u16(packet, 6) + _u16(packet, 8) + _u16(packet, 10), MOST_RECORDS):
		var name := _name(packet, at)
		at = name[1] + 10
		if at > packet.size():
			break
		var end := at + _u16(packet, at - 2)
		if end > packet.size():
			break
		var type := _u16(packet, at - 10)
		var data: Variant = _data(packet, type, at, end)
		if data != null:
			records.append({"name": name[0], "type": type, "data": data})
		at = end
	return records


## Read the data of a record; null if they are of another type, or damaged.
static func _data(packet: PackedByteArray, type: int, at: int, end: int) -> Variant:
	match type:
		A when end - at == 4:
			return "%d.%d.%d.%d" % [packet[at], packet[at + 1], packet[at + 2], packet[at + 3]]
		PTR:
			var name := _name(packet, at)
			return name[0] if name[1] <= end else null
		SRV when end - at > 6:
			var target := _name(packet, at + 6)
			return {"port": _u16(packet, at + 4), "target": target[0]} if target[1] <= end else null
		TXT:
			return _strings(packet, at, end)
	return null


static func _strings(packet: PackedByteArray, at: int, end: int) -> PackedStringArray:
	var strings := PackedStringArray()
	while at < end and at + 1 + packet[at] <= end:
		strings.append(Texts.read(packet.slice(at + 1, at + 1 + packet[at])))
		at += 1 + packet[at]
	return strings


## Return a name and where it ends, which is beyond the packet if it is damaged. Pointers lead backwards only, so that
## there is an end to them.
static func _name(packet: PackedByteArray, at: int) -> Array:
	var labels := PackedStringArray()
	var end := -1
	var before := at
	while at < packet.size() and labels.size() < MOST_LABELS:
		var length := packet[at]
		if length == 0:
			return [".".join(labels), end if end >= 0 else at + 1]
		if length < 64:
			if at + 1 + length > packet.size():
				break
			labels.append(Texts.read(packet.slice(at + 1, at + 1 + length)))
			at += 1 + length
		elif length >= 0xC0 and at + 1 < packet.size():
			var to := _u16(packet, at) & 0x3FFF
			if to >= before:
				break
			end = end if end >= 0 else at + 2
			at = to
			before = to
		else:
			break
	return ["", packet.size() + 1]


static func _u16(packet: PackedByteArray, at: int) -> int:
	return packet[at] << 8 | packet[at + 1]
