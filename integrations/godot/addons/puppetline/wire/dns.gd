extends RefCounted
## Reader and writer of the DNS messages that service discovery needs. Reading never goes beyond the packet.

const Texts := preload("texts.gd")

const A := 1
const PTR := 12
const TXT := 16
const SRV := 33

const MAX_RECORDS := 512
## Maximum number of labels in a name: 127 fit into its maximum length of 255 bytes.
const MAX_LABELS := 127

const _CLASS_INTERNET := 1
const _HEADER_BYTES := 12
const _ANSWER_FLAG := 0x8000


## Write a question.
static func question(name: String, type: int) -> PackedByteArray:
	var packet := PackedByteArray([0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0])
	for label in name.split("."):
		packet.append(label.length())
		packet.append_array(label.to_utf8_buffer())
	packet.append_array([0, 0, type, 0, _CLASS_INTERNET])
	return packet


## Read the records of an answer that have one of the types above: dictionaries of `name`, `type` and `data`, which is a
## String for PTR and A, a PackedStringArray for TXT, and `{"port", "target"}` for SRV. Records after damaged data are
## skipped. Strings that are not UTF-8 are empty.
static func parse(packet: PackedByteArray) -> Array[Dictionary]:
	var records: Array[Dictionary] = []
	if packet.size() < _HEADER_BYTES or not _u16(packet, 2) & _ANSWER_FLAG:
		return records
	var at := _HEADER_BYTES
	for _i in _u16(packet, 4):
		at = _read_name(packet, at)[1] + 4
		if at > packet.size():
			return records
	for _i in mini(_u16(packet, 6) + _u16(packet, 8) + _u16(packet, 10), MAX_RECORDS):
		var name := _read_name(packet, at)
		at = name[1] + 10
		if at > packet.size():
			break
		var end := at + _u16(packet, at - 2)
		if end > packet.size():
			break
		var type := _u16(packet, at - 10)
		var data: Variant = _read_data(packet, type, at, end)
		if data != null:
			records.append({"name": name[0], "type": type, "data": data})
		at = end
	return records


## Read the data of a record; null if the type is unknown or the data is damaged.
static func _read_data(packet: PackedByteArray, type: int, at: int, end: int) -> Variant:
	match type:
		A when end - at == 4:
			return "%d.%d.%d.%d" % [packet[at], packet[at + 1], packet[at + 2], packet[at + 3]]
		PTR:
			var name := _read_name(packet, at)
			return name[0] if name[1] <= end else null
		SRV when end - at > 6:
			var target := _read_name(packet, at + 6)
			return {"port": _u16(packet, at + 4), "target": target[0]} if target[1] <= end else null
		TXT:
			return _read_strings(packet, at, end)
	return null


static func _read_strings(packet: PackedByteArray, at: int, end: int) -> PackedStringArray:
	var strings := PackedStringArray()
	while at < end and at + 1 + packet[at] <= end:
		strings.append(Texts.read(packet.slice(at + 1, at + 1 + packet[at])))
		at += 1 + packet[at]
	return strings


## Return a name and the position of its end, which is beyond the packet if the name is damaged. Pointers must lead
## backwards, so that reading terminates.
static func _read_name(packet: PackedByteArray, at: int) -> Array:
	var labels := PackedStringArray()
	var end := -1
	var before := at
	while at < packet.size() and labels.size() < MAX_LABELS:
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
