extends RefCounted
## Texts in datagrams from anybody: the engine prints an error for each that is not what it should be.


## Read UTF-8; empty if it is none, or has zero bytes in it.
static func read(bytes: PackedByteArray) -> String:
	if bytes.is_empty():
		return ""
	var sorted := bytes.duplicate()  # the lowest and the highest without a loop in script
	sorted.sort()
	if sorted[0] == 0 or (sorted[-1] > 0x7F and not _is_utf8(bytes)):
		return ""
	return bytes.get_string_from_utf8()


static func _is_utf8(bytes: PackedByteArray) -> bool:
	var at := 0
	while at < bytes.size():
		var length := _length(bytes[at])
		if length == 0 or at + length > bytes.size():
			return false
		var code := bytes[at] & (0xFF >> length)
		for k in range(1, length):
			if bytes[at + k] & 0xC0 != 0x80:
				return false
			code = code << 6 | bytes[at + k] & 0x3F
		# Too long for what it says, half of a pair, or beyond the last character.
		if (length == 3 and code < 0x800) or (length == 4 and code < 0x10000) or code >> 11 == 27 or code > 0x10FFFF:
			return false
		at += length
	return true


## Return how many bytes a character has that begins with this one, 0 if none does.
static func _length(first: int) -> int:
	if first < 0x80:
		return 1
	if first < 0xC2 or first > 0xF4:
		return 0
	return 2 if first < 0xE0 else 3 if first < 0xF0 else 4
