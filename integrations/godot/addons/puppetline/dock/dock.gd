@tool
extends MarginContainer
## Puppetline's dock, which shows a service, a character, its state and performer, and the mapping of its handles.

const Service := preload("service.gd")
const Discovery := preload("../wire/discovery.gd")
const CharacterStatus := preload("character_status.gd")
const Editor := preload("editor.gd")
const MappingTable := preload("mapping_table.gd")
const Puppet3DNode := preload("../puppet_3d.gd")

const DEFAULT_ADDRESS := "127.0.0.1:7400"
const DEFAULT_PORT := 7400
## Tooltip of a service that requires CURVE keys.
const CURVE_TOOLTIP := "The service requires CURVE keys, which the addon does not support. Add a token to the service."
## Texts for the states of a character.
const STATE_TEXTS := {
	"waiting": "No performer",
	"calibrating": "User %d detected: stand still for one second",
	"performing": "User %d performs",
	"leaving": "The performer has left",
}

var service := Service.new()

var _discovery := Discovery.new()
var _mapping := MappingTable.new()

@onready var _address: LineEdit = %Address
@onready var _found: MenuButton = %Found
@onready var _token: LineEdit = %Token
@onready var _connection: Label = %Connection
@onready var _character: OptionButton = %Character
@onready var _facts: Label = %Facts
@onready var _performer: OptionButton = %Performer
@onready var _add_to_scene: Button = %AddToScene
@onready var _calibrate: Button = %Calibrate
@onready var _mirror: Button = %Mirror
@onready var _record: Button = %Record
@onready var _no_mapping: Label = %NoMapping
@onready var _save: Button = %Save
@onready var _revert: Button = %Revert
@onready var _trouble: Control = %Trouble
@onready var _trouble_text: Label = %TroubleText


func _ready() -> void:
	%MappingPlace.add_child(_mapping)
	_address.text = Editor.recall("address", DEFAULT_ADDRESS)
	_address.text_submitted.connect(func(_text: String) -> void: connect_to_service())
	_token.text_submitted.connect(func(_text: String) -> void: connect_to_service())
	%Connect.pressed.connect(connect_to_service)
	_found.get_popup().index_pressed.connect(_choose_found)
	_character.item_selected.connect(func(i: int) -> void: service.choose(_character.get_item_text(i)))
	_add_to_scene.pressed.connect(_add_character)
	_performer.item_selected.connect(func(i: int) -> void: service.choose_user(_performer.get_item_metadata(i)))
	_calibrate.pressed.connect(service.calibrate)
	_mirror.toggled.connect(service.set_mirror)
	_record.toggled.connect(service.set_recording)
	_mapping.handle_edited.connect(service.set_handle)
	_mapping.root_edited.connect(service.set_root)
	_mapping.scale_edited.connect(service.set_scale)
	_save.pressed.connect(service.save)
	_revert.pressed.connect(service.revert)
	%TroubleSeen.pressed.connect(_trouble.hide)
	_discovery.changed.connect(_show_found)
	service.changed.connect(_show)
	service.mapping_changed.connect(_show_mapping)
	service.refused.connect(_show_trouble)
	service.done.connect(_trouble.hide)
	visibility_changed.connect(_follow_visibility)
	_show_found()
	_show()
	_follow_visibility()


## The editor moves a dock by removing it from the tree and adding it again.
func _enter_tree() -> void:
	if is_node_ready():
		_follow_visibility()


func _exit_tree() -> void:
	service.close()


func _process(_delta: float) -> void:
	if not service.is_open():
		return
	_discovery.poll()
	service.poll()
	_mapping.show_activity(service.activity.shares)


## Follow the service with the entered address and token.
func connect_to_service() -> void:
	var text := _address.text.strip_edges().trim_prefix("tcp://")
	var colon := text.rfind(":")
	var host := text.substr(0, colon) if colon >= 0 else text
	var port := text.substr(colon + 1).to_int() if colon >= 0 else DEFAULT_PORT
	_open(host.trim_prefix("[").trim_suffix("]"), port, 0)


## Follow a service. A token that was entered for another service is not sent to it, but cleared.
func _open(host: String, port: int, control_port: int) -> void:
	_trouble.hide()
	var is_other := host != service.host or port != service.port
	if is_other and _token.text.strip_edges() == service.token:
		_token.clear()
	Editor.remember("address", _address.text)
	service.open(host, port, _token.text.strip_edges(), control_port)


## Disconnect while the dock is hidden.
func _follow_visibility() -> void:
	if not is_visible_in_tree():
		service.close()
	elif not service.is_open():
		connect_to_service()
	set_process(is_visible_in_tree())


func _show_found() -> void:
	var menu := _found.get_popup()
	menu.clear()
	for each: Dictionary in _discovery.services:
		menu.add_item("%s: %s" % [each.name, ", ".join(each.characters)])
		if each.mechanism == "CURVE":
			menu.set_item_disabled(-1, true)
			menu.set_item_tooltip(-1, CURVE_TOOLTIP)
	_found.disabled = menu.item_count == 0
	_found.tooltip_text = ("Services on this network" if menu.item_count else "No service found on this network")


func _choose_found(index: int) -> void:
	var chosen: Dictionary = _discovery.services[index]
	_address.text = ("[%s]:%d" if ":" in chosen.host else "%s:%d") % [chosen.host, chosen.port]
	if chosen.host != service.host or chosen.port != service.port:
		_token.clear()  # also one that was entered before the choice: any program can announce itself
	_open(chosen.host, chosen.port, chosen.control)
	if chosen.mechanism == "PLAIN" and _token.text.is_empty():
		_token.grab_focus()


func _show() -> void:
	_connection.text = service.connection
	var character := service.chosen
	var names := service.characters.map(func(each: CharacterStatus) -> String: return each.name)
	_set_items(_character, names, names)
	for each: BaseButton in [_character, _performer, _mirror, _record, _calibrate, _add_to_scene]:
		each.disabled = character == null
	_record.disabled = _record.disabled or character.stage.is_empty()
	_facts.visible = character != null
	_show_mapping()
	if character == null:
		return
	_character.select(names.find(character.name))
	_facts.text = _facts_text(character)
	var users: Array = [CharacterStatus.NO_USER]
	users.append_array(character.users)
	var titles := users.map(func(user: int) -> String: return "User %d" % user if user >= 0 else "Any performer")
	_set_items(_performer, titles, users)
	_performer.select(maxi(users.find(character.user), 0))
	_mirror.set_pressed_no_signal(character.mirror)
	_record.set_pressed_no_signal(not character.recording.is_empty())
	_record.text = "Recording" if character.recording else "Record"
	_record.tooltip_text = (
		"Records the take %s" % character.recording if character.recording else "Record a take of the stage"
	)


func _facts_text(character: CharacterStatus) -> String:
	var state: String = STATE_TEXTS.get(character.state, character.state)
	var text := state % character.user if "%d" in state else state
	text += "\n%.0f frames per second" % character.rate
	if character.latency >= 0.0:
		text += ", %.1f ms from sensor to network" % character.latency
	return text


func _show_mapping() -> void:
	var mapping := service.mapping
	_mapping.show_mapping(mapping)
	_no_mapping.visible = mapping == null
	var recording := service.chosen != null and not service.chosen.recording.is_empty()
	_mapping.set_disabled(recording)
	_save.disabled = mapping == null or mapping.saved
	_revert.disabled = mapping == null or mapping.saved or recording


func _show_trouble(text: String) -> void:
	_trouble_text.text = text
	_trouble.show()
	_show()


func _add_character() -> void:
	if service.chosen == null:
		return
	var puppet: Puppet3D = Puppet3DNode.new()
	puppet.name = service.chosen.name
	puppet.host = service.host
	puppet.port = service.port
	puppet.token = service.token
	puppet.character = service.chosen.name
	var obstacle := Editor.add_to_scene(puppet)
	if obstacle:
		_show_trouble(obstacle)


## Set the items of a button. If they are unchanged, leave them, so that an open menu stays as it is.
func _set_items(button: OptionButton, titles: Array, values: Array) -> void:
	var before := range(button.item_count).map(func(i: int) -> Variant: return button.get_item_metadata(i))
	if before == values:
		return
	button.clear()
	for i in titles.size():
		button.add_item(titles[i])
		button.set_item_metadata(i, values[i])
