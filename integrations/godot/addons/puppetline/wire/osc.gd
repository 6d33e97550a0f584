extends RefCounted
## Reader and writer of OSC 1.0 datagrams. Reading never goes beyond the datagram.

const Texts := preload("texts.gd")

## Maximum nesting depth of bundles.
const MAX_BUNDLE_DEPTH := 4
## Maximum number of messages in one datagram.
const MAX_MESSAGES := 1024
## Maximum length of an address, in characters.
const MAX_ADDRESS_LENGTH := 255

const _BUNDLE := "#bundle"


## Read a datagram: an array with [address, arguments] per message, in the order of the bundles. It is empty if any part
## of the datagram is invalid.
static func parse(packet: PackedByteArray) -> Array:
	var messages: Array = []
	return messages if _read_packet(packet, 0, messages) else []


## Write a message: int as i (h beyond 32 bits), float as f, String as s, PackedByteArray as b, true, false and null as
## T, F and N, PackedFloat32Array as one f per number.
static func encode(address: String, arguments: Array) -> PackedByteArray:
	var tags := ","
	var data := StreamPeerBuffer.new()
	data.big_endian = true
	for argument: Variant in arguments:
		tags += _write(argument, data)
	return _padded(address) + _padded(tags) + data.data_array


static func _read_packet(packet: PackedByteArray, depth: int, messages: Array) -> bool:
	if packet.is_empty() or packet.size() % 4 or messages.size() >= MAX_MESSAGES:
		return false
	if packet.slice(0, 8) != _padded(_BUNDLE):
		var message := _read_message(packet)
		messages.append(message)
		return not message.is_empty()
	if packet.size() < 16 or depth == MAX_BUNDLE_DEPTH:
		return false
	var at := 16
	while at < packet.size():
		var size := _u32(packet, at)
		if size == 0 or size > packet.size() - at - 4:
			return false
		if not _read_packet(packet.slice(at + 4, at + 4 + size), depth + 1, messages):
			return false
		at += 4 + size
	return true


## Return [address, arguments], or an empty array if the message is damaged.
static func _read_message(packet: PackedByteArray) -> Array:
	var reader := _Reader.new(packet)
	var address := reader.text()
	var tags := reader.text()
	if not address.begins_with("/") or address.length() > MAX_ADDRESS_LENGTH or not tags.begins_with(","):
		return []
	var arguments := reader.arguments(tags.substr(1))
	return [address, arguments] if reader.is_whole() else []


static func _write(argument: Variant, data: StreamPeerBuffer) -> String:
	match typeof(argument):
		TYPE_INT when argument == clampi(argument, -0x80000000, 0x7FFFFFFF):
			data.put_32(argument)
			return "i"
		TYPE_INT:
			data.put_64(argument)
			return "h"
		TYPE_FLOAT:
			data.put_float(argument)
			return "f"
		TYPE_BOOL:
			return "T" if argument else "F"
		TYPE_STRING, TYPE_STRING_NAME:
			data.put_data(_padded(argument))
			return "s"
		TYPE_PACKED_BYTE_ARRAY:
			var padding := PackedByteArray()
			padding.resize(-argument.size() & 3)
			data.put_32(argument.size())
			data.put_data(argument + padding)
			return "b"
		TYPE_PACKED_FLOAT32_ARRAY:
			for number: float in argument:
				data.put_float(number)
			return "f".repeat(argument.size())
		TYPE_NIL:
			return "N"
	push_error(
		"Puppetline: skipped an argument of the type %s, which OSC does not support." % type_string(typeof(argument))
	)
	return ""


static func _padded(text: String) -> PackedByteArray:
	var bytes := text.to_utf8_buffer()
	bytes.resize((bytes.size() | 3) + 1)
	return bytes


static func _u32(bytes: PackedByteArray, at: int) -> int:
	return bytes[at] << 24 | bytes[at + 1] << 16 | bytes[at + 2] << 8 | bytes[at + 3]


## Reads one message from start to end. After an error it returns zeros, and [method is_whole] returns false.
class _Reader:
	var _bytes: PackedByteArray
	var _at := 0
	var _failed := false

	func _init(bytes: PackedByteArray) -> void:
		_bytes = bytes

	func is_whole() -> bool:
		return not _failed and _at == _bytes.size()

	func text() -> String:
		var end := _bytes.find(0, _at)
		if _failed or end < 0:
			_failed = true
			return ""
		var read := Texts.read(_bytes.slice(_at, end))
		_failed = read.is_empty() and end > _at
		_at = (end | 3) + 1
		return read

	func arguments(tags: String) -> Array:
		var read: Array = []
		var i := 0
		while i < tags.length() and not _failed:
			var run := 1
			if tags[i] == "f":
				while i + run < tags.length() and tags[i + run] == "f":
					run += 1
				read.append_array(_floats(run))
			else:
				read.append(_argument(tags[i]))
			i += run
		return read

	## Read consecutive numbers together: in reversed order, their bytes are little-endian.
	func _floats(count: int) -> Array:
		var bytes := _take(4 * count)
		bytes.reverse()
		var numbers := Array(bytes.to_float32_array())
		numbers.reverse()
		for number: float in numbers:
			if not is_finite(number):
				_failed = true
		return numbers

	func _argument(tag: String) -> Variant:
		var read: Variant = null
		match tag:
			"i":
				read = _reversed(4).decode_s32(0)
			"h", "t":
				read = _reversed(8).decode_s64(0)
			"d":
				read = _reversed(8).decode_double(0)
				_failed = _failed or not is_finite(read)
			"s", "S":
				read = text()
			"b":
				var size := _reversed(4).decode_u32(0)
				read = _take(size)
				_take(-size & 3)
			"T", "F":
				read = tag == "T"
			"N":
				pass
			_:
				_failed = true
		return read

	func _reversed(count: int) -> PackedByteArray:
		var bytes := _take(count)
		bytes.resize(count)
		bytes.reverse()
		return bytes

	func _take(count: int) -> PackedByteArray:
		if _failed or count > _bytes.size() - _at:
			_failed = true
			return PackedByteArray()
		_at += count
		return _bytes.slice(_at - count, _at)
