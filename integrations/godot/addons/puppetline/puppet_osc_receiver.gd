class_name PuppetOscReceiver
extends Node
## Receives what `puppetline serve --osc HOST:PORT` sends, as signals.
##
## Joints, handles and the like, without a mesh: for effects, sounds and characters of your own. [Puppet3D] needs none
## of this. See docs/osc.md for what the numbers mean.

## The joints of a performer, those that are known: metres in the sensor's frame. [param confidence] is 1 for a joint
## that is seen, 0.5 for a guessed, 0 for a lost one.
signal joints_received(
	character: String, names: PackedStringArray, positions: PackedVector3Array, confidence: PackedFloat32Array
)
## Where each handle is to be: coordinates of the mesh file.
signal handles_received(character: String, names: PackedStringArray, positions: PackedVector3Array)
## A 3 × 4 matrix a row after the other for each isoline, 960 numbers as a rule.
signal controls_received(character: String, transforms: PackedFloat32Array)
## How far each morph target of the baked .glb is in.
signal weights_received(character: String, weights: PackedFloat32Array)
## How far the character has walked, which goes with the weights.
signal root_received(character: String, root: Vector3)
## [param state] is "waiting", "calibrating", "performing" or "leaving", [param user] −1 for nobody.
signal performer_received(character: String, state: String, user: int)
## Any other message.
signal message_received(address: String, arguments: Array)

const Osc := preload("wire/osc.gd")

## Datagrams read in one process frame; those that are left wait for the next one.
const DATAGRAMS_A_FRAME := 512
## Bytes of datagrams that may wait.
const BUFFER := 1 << 20

## The UDP port that `--osc` names.
@export_range(1, 65535) var port := 9000:
	set(value):
		port = value
		_listen()
## The address of this machine that is listened at: "127.0.0.1" hears this machine only, "*" the network as well.
@export var bind_address := "127.0.0.1":
	set(value):
		bind_address = value
		_listen()
## The character that is of interest; every one if empty.
@export var character := ""

var _socket := PacketPeerUDP.new()


func _enter_tree() -> void:
	_listen()


func _exit_tree() -> void:
	_socket.close()


func _process(_delta: float) -> void:
	for _i in DATAGRAMS_A_FRAME:
		if _socket.get_available_packet_count() <= 0:
			return
		_dispatch(Osc.parse(_socket.get_packet()))


func _listen() -> void:
	_socket.close()
	if not is_inside_tree():
		return
	if _socket.bind(port, bind_address, BUFFER) != OK:
		push_warning(
			(
				"Puppetline: %s cannot listen at UDP port %d of '%s'. Does another program, or node, use it?"
				% [name, port, bind_address]
			)
		)


## Emit the signals of a datagram. Joints and handles come as one message each, and leave as one signal a datagram.
func _dispatch(messages: Array) -> void:
	var joints: Dictionary = {}
	var handles: Dictionary = {}
	for message: Array in messages:
		var address: String = message[0]
		var arguments: Array = message[1]
		var parts := address.split("/")  # "", "puppetline", character, what, name
		var own := parts.size() >= 4 and parts[1] == "puppetline"
		if own and character and parts[2] != character:
			continue
		var what := "/".join(parts.slice(3)) if own else ""
		if what.begins_with("joint/") and _are_numbers(arguments, 4):
			joints.get_or_add(parts[2], {})[what.substr(6)] = arguments
		elif what.begins_with("handle/") and _are_numbers(arguments, 3):
			handles.get_or_add(parts[2], {})[what.substr(7)] = arguments
		elif not own or not _emit(parts[2], what, arguments):
			message_received.emit(address, arguments)
	for of: String in joints:
		var found: Dictionary = joints[of]
		var confidence := found.values().map(func(numbers: Array) -> float: return numbers[3])
		joints_received.emit(of, PackedStringArray(found.keys()), _places(found), PackedFloat32Array(confidence))
	for of: String in handles:
		handles_received.emit(of, PackedStringArray(handles[of].keys()), _places(handles[of]))


## Emit what is a signal of its own; return false where it is none.
func _emit(of: String, what: String, arguments: Array) -> bool:
	match what:
		"controls" when arguments.size() % 12 == 0 and _are_numbers(arguments, arguments.size()):
			controls_received.emit(of, PackedFloat32Array(arguments))
		"morphs" when _are_numbers(arguments, arguments.size()):
			weights_received.emit(of, PackedFloat32Array(arguments))
		"root" when _are_numbers(arguments, 3):
			root_received.emit(of, Vector3(arguments[0], arguments[1], arguments[2]))
		"performer" when arguments.size() == 2 and arguments[0] is String and arguments[1] is int:
			performer_received.emit(of, arguments[0], arguments[1])
		_:
			return false
	return true


func _places(found: Dictionary) -> PackedVector3Array:
	var places := PackedVector3Array()
	for numbers: Array in found.values():
		places.append(Vector3(numbers[0], numbers[1], numbers[2]))
	return places


func _are_numbers(arguments: Array, count: int) -> bool:
	return arguments.size() == count and arguments.all(func(each: Variant) -> bool: return each is float)
