class_name PuppetOscReceiver
extends Node
## Receives the OSC messages of `puppetline serve --osc HOST:PORT` and emits them as signals.
##
## Use it for effects, sounds and your own characters, which need joints or handles without a mesh. [Puppet3D] does not
## need it. docs/osc.md explains the numbers.

## The known joints of a performer, in metres in sensor coordinates. [param confidence] is 1 for a tracked joint, 0.5
## for an inferred one and 0 for a lost one.
signal joints_received(
	character: String, names: PackedStringArray, positions: PackedVector3Array, confidence: PackedFloat32Array
)
## The target position of each handle, in file coordinates.
signal handles_received(character: String, names: PackedStringArray, positions: PackedVector3Array)
## One 3 × 4 matrix per isoline, row by row; usually 960 numbers.
signal controls_received(character: String, transforms: PackedFloat32Array)
## Weight of each morph target of the baked .glb.
signal weights_received(character: String, weights: PackedFloat32Array)
## Displacement of the character by root motion, sent together with the weights.
signal root_received(character: String, root: Vector3)
## [param state] is "waiting", "calibrating", "performing" or "leaving". [param user] is −1 if there is no performer.
signal performer_received(character: String, state: String, user: int)
## Any other message.
signal message_received(address: String, arguments: Array)

const Osc := preload("wire/osc.gd")

## Maximum number of datagrams read per process frame; the others wait for the next frame.
const MAX_FRAME_DATAGRAMS := 512
## Size of the receive buffer, in bytes.
const BUFFER_BYTES := 1 << 20

## UDP port given to `--osc`.
@export_range(1, 65535) var port := 9000:
	set(value):
		port = value
		_listen()
## Local address on which to listen: "127.0.0.1" receives from this machine only, "*" from the network too.
@export var bind_address := "127.0.0.1":
	set(value):
		bind_address = value
		_listen()
## Name of the character whose messages are received; empty for all characters.
@export var character := ""

var _socket := PacketPeerUDP.new()


func _enter_tree() -> void:
	_listen()


func _exit_tree() -> void:
	_socket.close()


func _process(_delta: float) -> void:
	for _i in MAX_FRAME_DATAGRAMS:
		if _socket.get_available_packet_count() <= 0:
			return
		_dispatch(Osc.parse(_socket.get_packet()))


func _listen() -> void:
	_socket.close()
	if not is_inside_tree():
		return
	if _socket.bind(port, bind_address, BUFFER_BYTES) != OK:
		push_warning(
			(
				"Puppetline: %s cannot listen on UDP port %d of '%s'. Check whether another program or node uses it."
				% [name, port, bind_address]
			)
		)


## Emit the signals of a datagram. The messages of all joints, and those of all handles, become one signal each.
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
		joints_received.emit(of, PackedStringArray(found.keys()), _positions(found), PackedFloat32Array(confidence))
	for of: String in handles:
		handles_received.emit(of, PackedStringArray(handles[of].keys()), _positions(handles[of]))


## Emit the signal for a message; return false if there is none.
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


func _positions(found: Dictionary) -> PackedVector3Array:
	var positions := PackedVector3Array()
	for numbers: Array in found.values():
		positions.append(Vector3(numbers[0], numbers[1], numbers[2]))
	return positions


func _are_numbers(arguments: Array, count: int) -> bool:
	return arguments.size() == count and arguments.all(func(each: Variant) -> bool: return each is float)
