@tool
extends EditorImportPlugin
## Imports .clip files of `puppetline clip` as [PuppetClip].


func _get_importer_name() -> String:
	return "puppetline.clip"


func _get_visible_name() -> String:
	return "Puppetline Clip"


func _get_recognized_extensions() -> PackedStringArray:
	return ["clip"]


func _get_save_extension() -> String:
	return "res"


func _get_resource_type() -> String:
	return "Resource"


func _get_preset_count() -> int:
	return 1


func _get_preset_name(_preset: int) -> String:
	return "Default"


func _get_import_options(_path: String, _preset: int) -> Array[Dictionary]:
	return []


func _get_option_visibility(_path: String, _option: StringName, _options: Dictionary) -> bool:
	return true


func _get_priority() -> float:
	return 1.0


func _get_import_order() -> int:
	return 0


func _import(
	source_file: String,
	save_path: String,
	_options: Dictionary,
	_platform_variants: Array[String],
	_gen_files: Array[String]
) -> Error:
	var clip := PuppetClip.new()
	clip.data = FileAccess.get_file_as_bytes(source_file)
	if clip.problem():
		push_error("Puppetline: %s: found %s; expected a file of `puppetline clip`." % [source_file, clip.problem()])
		return ERR_FILE_CORRUPT
	return ResourceSaver.save(clip, "%s.%s" % [save_path, _get_save_extension()], ResourceSaver.FLAG_COMPRESS)
