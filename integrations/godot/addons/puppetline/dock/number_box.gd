@tool
extends SpinBox
## A number of three decimals at most.

signal edited(number: float)

const _DECIMALS := 3


func _init() -> void:
	step = 0.001
	custom_arrow_step = 0.1
	value_changed.connect(func(_value: float) -> void: edited.emit(number()))


## Return what is to be seen: a SpinBox itself counts in steps, which are no round numbers.
func number() -> float:
	return String.num(value, _DECIMALS).to_float()


## Show a number that somebody else has set.
func show_number(shown: float) -> void:
	if String.num(shown, _DECIMALS).to_float() != number():
		set_value_no_signal(shown)
