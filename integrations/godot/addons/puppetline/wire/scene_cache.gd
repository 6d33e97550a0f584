extends RefCounted
## Payloads of scenes in files of the user's folder, by the digest that the service announces.
##
## The functions may run in a thread.

const _FOLDER := "user://puppetline/scenes"
const _DIGEST_CHARACTERS := 64
## Maximum number of files. The oldest ones are deleted.
const _MAX_FILES := 32


## Return whether there is a file for a digest.
static func has(digest: String) -> bool:
	return _is_digest(digest) and FileAccess.file_exists(_path(digest))


## Return the payload with a digest; empty if there is none. A damaged file is deleted.
static func load_payload(digest: String) -> PackedByteArray:
	if not has(digest):
		return PackedByteArray()
	var payload := FileAccess.get_file_as_bytes(_path(digest))
	if digest_of(payload) == digest:
		return payload
	DirAccess.remove_absolute(_path(digest))
	return PackedByteArray()


## Keep a payload. The file is written under another name and then renamed, so that it is never incomplete.
static func save(digest: String, payload: PackedByteArray) -> void:
	if has(digest):
		return
	DirAccess.make_dir_recursive_absolute(_FOLDER)
	var part := "%s/%08x.part" % [_FOLDER, randi()]
	var file := FileAccess.open(part, FileAccess.WRITE)
	if file == null:
		return
	var is_whole := file.store_buffer(payload)
	file.close()
	if not is_whole or DirAccess.rename_absolute(part, _path(digest)) != OK:
		DirAccess.remove_absolute(part)
	_delete_old()


## Return the digest of a payload (docs/protocol.md, "Keep scenes"), in hexadecimal digits.
static func digest_of(payload: PackedByteArray) -> String:
	if payload.size() < 4:
		return ""
	var arrays_start := 4 + payload.decode_u32(0)
	return _sha256(payload.slice(0, arrays_start) + _sha256(payload.slice(arrays_start))).hex_encode()


static func _sha256(bytes: PackedByteArray) -> PackedByteArray:
	var hashing := HashingContext.new()
	hashing.start(HashingContext.HASH_SHA256)
	if not bytes.is_empty():
		hashing.update(bytes)
	return hashing.finish()


## Return whether a text is a digest. It comes from the service and becomes part of a path.
static func _is_digest(text: String) -> bool:
	return text.length() == _DIGEST_CHARACTERS and text.is_valid_hex_number()


static func _path(digest: String) -> String:
	return "%s/%s.scene" % [_FOLDER, digest]


static func _delete_old() -> void:
	var paths: Array = Array(DirAccess.get_files_at(_FOLDER)).map(
		func(name: String) -> String: return _FOLDER.path_join(name)
	)
	paths.sort_custom(
		func(a: String, b: String) -> bool: return FileAccess.get_modified_time(a) > FileAccess.get_modified_time(b)
	)
	for path: String in paths.slice(_MAX_FILES):
		DirAccess.remove_absolute(path)
