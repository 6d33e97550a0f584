@tool
extends Control
## A bar whose length shows the activity of a handle.

const Editor := preload("editor.gd")

## Activity from 0 (at rest) to 1.
var share := 0.0:
	set(value):
		if share != value:
			share = value
			queue_redraw()


func _draw() -> void:
	var color := Editor.accent(self)
	draw_rect(Rect2(Vector2.ZERO, size), Color(color, 0.15))
	draw_rect(Rect2(Vector2.ZERO, Vector2(share * size.x, size.y)), color)
