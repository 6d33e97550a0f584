extends RefCounted
## The performer of a character, as the service reports it, and what has changed.

## Emitted when a performer has been found for the character.
signal found(user: int)
## Emitted when the performer has been calibrated and drives the character.
signal calibrated(user: int)
## Emitted when the performer has left.
signal lost(user: int)

const Message := preload("message.gd")

## User number of the performer to report; others are ignored. −1 for any performer.
var slot := -1:
	set(value):
		slot = value
		notice(_last_user, _last_state)
## User number of the present performer, or −1.
var user := Message.NO_USER
var is_calibrated := false

var _last_user := Message.NO_USER  # as reported by the service
var _last_state := Message.PerformerState.WAITING


## Take notice of a report of the service.
func notice(reported_user: int, state: Message.PerformerState) -> void:
	_last_user = reported_user
	_last_state = state
	var is_present := state == Message.PerformerState.CALIBRATING or state == Message.PerformerState.PERFORMING
	var now := reported_user if is_present and (slot < 0 or reported_user == slot) else Message.NO_USER
	if now != user:
		var before := user
		user = now
		is_calibrated = false
		if before != Message.NO_USER:
			lost.emit(before)
		if now != Message.NO_USER and now == user:
			found.emit(now)
	if now != user:
		return  # a receiver of the signal has changed it
	var performs := now != Message.NO_USER and state == Message.PerformerState.PERFORMING
	if performs and not is_calibrated:
		calibrated.emit(now)
	is_calibrated = performs


## Take notice of the end of the connection.
func clear() -> void:
	notice(Message.NO_USER, Message.PerformerState.WAITING)
