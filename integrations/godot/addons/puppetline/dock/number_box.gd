@tool
extends SpinBox
## A box for a number with at most three decimals.

signal edited(number: float)

const _DECIMALS := 3


func _init() -> void:
	step = 0.001
	custom_arrow_step = 0.1
	value_changed.connect(func(_value: float) -> void: edited.emit(number()))


## Return the shown number. The value of a SpinBox is a multiple of its step, which is not exactly decimal.
func number() -> float:
	return String.num(value, _DECIMALS).to_float()


## Show a number without emitting [signal edited].
func show_number(shown: float) -> void:
	if String.num(shown, _DECIMALS).to_float() != number():
		set_value_no_signal(shown)
