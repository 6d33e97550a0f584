extends RefCounted
## Searches for the point where a segment hits the surface of a character that is shown by controls.
##
## The triangles are divided into the pieces of the bounds, and each piece into blocks. Only the vertices of blocks
## whose boxes are hit are evaluated. The pieces are divided when they are first hit.

const Scene := preload("../wire/scene.gd")
const IsolineBounds := preload("isoline_bounds.gd")

## Number of blocks of a piece along each axis.
const _BLOCKS := 3
## Diagonal to which the character is scaled for the intersection test, because the engine's function ignores triangles
## that are very small.
const _SCALE := 1000.0

var _scene: Scene
var _bounds: IsolineBounds
var _pieces: Array[Block] = []


## Some triangles and a bound of them.
class Block:
	var triangles := PackedInt32Array()
	var piece: IsolineBounds.Piece
	## The same triangles in smaller blocks; empty before they are needed.
	var blocks: Array[Block] = []


func _init(scene: Scene, bounds: IsolineBounds) -> void:
	_scene = scene
	_bounds = bounds
	var piece_of := PackedInt32Array()
	piece_of.resize(_scene.vertex_count)
	for i in _bounds.vertices.size():
		_pieces.append(Block.new())
		for vertex in _bounds.vertices[i]:
			piece_of[vertex] = i
	for triangle in _scene.triangle_count:
		_pieces[piece_of[_scene.triangles[3 * triangle]]].triangles.append(triangle)
	for block in _pieces:
		_bound(block)


## Return the nearest hit of a segment in the coordinates of the character, for the numbers of a frame: `triangle`, its
## `corners` and the `position`; empty if there is none.
func intersect(numbers: PackedFloat32Array, from: Vector3, to: Vector3) -> Dictionary:
	_bounds.read(numbers)
	var hit := {}
	for block in _hit(_pieces, from, to):
		if block.blocks.is_empty():
			_divide(block)
		for inner in _hit(block.blocks, from, to):
			hit = _nearest(inner, from, hit.get("position", to), hit)
	return hit


## Return the pieces of the bounds, extended to all vertices of their triangles, so that they have no gaps between them.
func pieces() -> Array[IsolineBounds.Piece]:
	var found: Array[IsolineBounds.Piece] = []
	for block in _pieces:
		if block.piece != null:
			found.append(block.piece)
	return found


func _hit(blocks: Array[Block], from: Vector3, to: Vector3) -> Array[Block]:
	return blocks.filter(
		func(block: Block) -> bool:
			return not block.triangles.is_empty() and _bounds.box(block.piece).intersects_segment(from, to) != null
	)


func _nearest(block: Block, from: Vector3, to: Vector3, otherwise: Dictionary) -> Dictionary:
	var positions: Dictionary = {}  # by vertex
	var hit := otherwise
	for triangle in block.triangles:
		var corners := PackedVector3Array()
		for i in 3:
			var vertex := _scene.triangles[3 * triangle + i]
			if vertex not in positions:
				positions[vertex] = _bounds.position(_scene, vertex)
			corners.append(positions[vertex])
		var position: Variant = segment_hit(corners, from, to, _scene.diagonal)
		if position != null:
			to = position
			hit = {"triangle": triangle, "corners": corners, "position": position}
	return hit


## Return where a segment hits a triangle of a mesh with a diagonal, or null.
static func segment_hit(corners: PackedVector3Array, from: Vector3, to: Vector3, diagonal: float) -> Variant:
	var scale := _SCALE / diagonal
	var found: Variant = Geometry3D.segment_intersects_triangle(
		scale * from, scale * to, scale * corners[0], scale * corners[1], scale * corners[2]
	)
	return null if found == null else found / scale


## Divide the triangles of a block by the positions of their first vertices at rest.
func _divide(block: Block) -> void:
	var low := block.piece.box.position
	var cell := (block.piece.box.size / _BLOCKS).max(Vector3.ONE * 1e-6 * _scene.diagonal)
	var cells: Dictionary = {}
	for triangle in block.triangles:
		var at := Vector3i((_scene.positions[_scene.triangles[3 * triangle]] - low) / cell)
		if at not in cells:
			cells[at] = Block.new()
		(cells[at] as Block).triangles.append(triangle)
	for inner: Block in cells.values():
		_bound(inner)
		block.blocks.append(inner)


## Bound a block, with all vertices of its triangles.
func _bound(block: Block) -> void:
	var vertices: Dictionary = {}
	for triangle in block.triangles:
		for i in 3:
			vertices[_scene.triangles[3 * triangle + i]] = true
	if not vertices.is_empty():
		block.piece = IsolineBounds.make_piece(_scene, PackedInt32Array(vertices.keys()))
