extends Control
## Menu of the two demo scenes.

@onready var _kiosk: Button = $Middle/Column/Kiosk
@onready var _film: Button = $Middle/Column/Film


func _ready() -> void:
	_kiosk.pressed.connect(_open.bind("res://demo/kiosk/kiosk.tscn"))
	_film.pressed.connect(_open.bind("res://demo/film/film.tscn"))
	_kiosk.grab_focus()


func _open(scene: String) -> void:
	get_tree().change_scene_to_file(scene)
