extends RefCounted
## Decoding of strings in untrusted datagrams. The engine's own functions would print an error for each invalid string.


## Return the decoded UTF-8; empty if the bytes are not valid UTF-8 or contain a zero byte.
static func read(bytes: PackedByteArray) -> String:
	if bytes.is_empty():
		return ""
	var sorted := bytes.duplicate()  # finds minimum and maximum without a loop in script
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
		# The encoding is too long, half of a surrogate pair, or beyond the last character.
		if (length == 3 and code < 0x800) or (length == 4 and code < 0x10000) or code >> 11 == 27 or code > 0x10FFFF:
			return false
		at += length
	return true


## Return the number of bytes of a character that begins with this byte; 0 if no character does.
static func _length(first: int) -> int:
	if first < 0x80:
		return 1
	if first < 0xC2 or first > 0xF4:
		return 0
	return 2 if first < 0xE0 else 3 if first < 0xF0 else 4
