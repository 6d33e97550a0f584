extends RefCounted
## Bounding box of a character that the graphics card deforms. Its cost does not depend on the number of vertices.
##
## Each field interpolates a vertex between the transforms of two isolines, and the weights of the fields add up to 1.
## The vertices are divided into pieces with similar isoline coordinates. The mean transform of a piece, at the middle
## of its coordinates, approximates the positions of its vertices. The change of the transforms over its coordinates
## bounds the error. A single transform can be far away from the character, but the mean is not, and the change is small
## within a small piece.

const Scene := preload("../wire/scene.gd")

## Number of floats in a transform.
const _TRANSFORM_FLOATS := 12
## Maximum number of pieces.
const _PIECE_COUNT := 48
## Approximate number of vertices from which the cuts between pieces are computed.
const _SAMPLE_COUNT := 2000
## Minimum spread of isoline coordinates, in isolines; smaller ones count as zero.
const _MIN_SPREAD := 1e-6

## The pieces of all vertices, and by piece the numbers of its vertices.
var pieces: Array[Piece] = []
var vertices: Array[PackedInt32Array] = []

## Columns of each transform of the last [method read], and the difference between each one and the next.
var _x := PackedVector3Array()
var _y := PackedVector3Array()
var _z := PackedVector3Array()
var _origin := PackedVector3Array()
var _differences: Array[Transform3D] = []
var _transform_count := 0
var _target_weights := PackedFloat32Array()


## Vertices with similar isoline coordinates in all fields.
class Piece:
	## Bounding box at rest, over all weights of the mesh's own targets.
	var box: AABB
	## The transforms whose weighted mean belongs to the middle of the piece, and their weights.
	var isolines := PackedInt32Array()
	var shares := PackedFloat32Array()
	## Gaps between two isolines that contain coordinates of the piece, each as the index of the lower isoline.
	var gaps := PackedInt32Array()
	## Spread of the coordinates in each gap, below and above the middle, times the weight of the field.
	var below := PackedFloat32Array()
	var above := PackedFloat32Array()
	## Number of gaps of each field.
	var counts := PackedInt32Array()


## A cut: vertices with a greater coordinate in one field become a new piece.
class _Cut:
	var field := 0
	var coordinate := 0.0
	## Spread of the coordinates that the cut divides, times the weight of the field.
	var spread := 0.0
	var piece_beyond := 0
	## The next cuts on this side and beyond.
	var next: _Cut = null
	var next_beyond: _Cut = null

	## Append a cut of one of the two pieces.
	func follow(piece: int, cut: _Cut) -> void:
		if piece == piece_beyond:
			next_beyond = cut
		else:
			next = cut


func _init(scene: Scene) -> void:
	_transform_count = scene.field_count * scene.isoline_count
	vertices = _divide(scene)
	for each in vertices:
		pieces.append(make_piece(scene, each))


## Return a box that contains all vertices, for the numbers of a frame.
func around(numbers: PackedFloat32Array) -> AABB:
	read(numbers)
	var low := Vector3.INF
	var high := -Vector3.INF
	for piece in pieces:
		var moved := box(piece)
		low = low.min(moved.position)
		high = high.max(moved.end)
	return AABB(low, high - low)


## Return a box that contains the vertices of a piece, for the transforms of [method read].
func box(piece: Piece) -> AABB:
	var spread := _spread(piece)
	var moved := mean_transform(piece) * piece.box
	return AABB(moved.position - spread, moved.size + 2.0 * spread)


## Return the mean transform of a piece, for the transforms of [method read].
func mean_transform(piece: Piece) -> Transform3D:
	var x := Vector3.ZERO
	var y := Vector3.ZERO
	var z := Vector3.ZERO
	var origin := Vector3.ZERO
	for i in piece.isolines.size():
		var share := piece.shares[i]
		var isoline := piece.isolines[i]
		x += share * _x[isoline]
		y += share * _y[isoline]
		z += share * _z[isoline]
		origin += share * _origin[isoline]
	return Transform3D(x, y, z, origin)


## Return the position of a vertex, for the transforms of [method read].
func position(scene: Scene, vertex: int) -> Vector3:
	var last := scene.isoline_count - 2
	var rest := scene.rest_position(vertex, _target_weights)
	var sum := Vector3.ZERO
	for field in scene.field_count:
		var coordinate := scene.isoline_coordinates[vertex * scene.field_count + field]
		var isoline := clampi(int(coordinate), 0, last)
		var at := field * scene.isoline_count + isoline
		var lower := _x[at] * rest.x + _y[at] * rest.y + _z[at] * rest.z + _origin[at]
		at += 1
		var upper := _x[at] * rest.x + _y[at] * rest.y + _z[at] * rest.z + _origin[at]
		sum += scene.weights[field] * lower.lerp(upper, coordinate - isoline)
	return sum


## Return the maximum distance, by axis, of the vertices of a piece from their positions by the mean transform.
func _spread(piece: Piece) -> Vector3:
	var rest := piece.box
	var spread := Vector3.ZERO
	var entry := 0
	for count in piece.counts:
		var below := Vector3.ZERO
		var above := Vector3.ZERO
		for _i in count:
			var moved := _differences[piece.gaps[entry]] * rest
			var change := moved.position.abs().max(moved.end.abs())
			below += piece.below[entry] * change
			above += piece.above[entry] * change
			entry += 1
		spread += below.max(above)
	return spread


## Take the numbers of a frame: the transforms, 12 floats each, the three rows of a matrix, and then the weights of the
## mesh's own targets.
func read(numbers: PackedFloat32Array) -> void:
	var count := _transform_count
	_target_weights = numbers.slice(count * _TRANSFORM_FLOATS)
	for columns: PackedVector3Array in [_x, _y, _z, _origin]:
		columns.resize(count)
	for i in count:
		var at := i * _TRANSFORM_FLOATS
		_x[i] = Vector3(numbers[at], numbers[at + 4], numbers[at + 8])
		_y[i] = Vector3(numbers[at + 1], numbers[at + 5], numbers[at + 9])
		_z[i] = Vector3(numbers[at + 2], numbers[at + 6], numbers[at + 10])
		_origin[i] = Vector3(numbers[at + 3], numbers[at + 7], numbers[at + 11])
	_differences.resize(count)
	for i in count - 1:
		_differences[i] = Transform3D(
			_x[i + 1] - _x[i], _y[i + 1] - _y[i], _z[i + 1] - _z[i], _origin[i + 1] - _origin[i]
		)


## Divide the vertices into pieces, by the cuts that were computed from samples.
static func _divide(scene: Scene) -> Array[PackedInt32Array]:
	var cuts := _cuts(scene)
	var fields := scene.field_count
	var pieces: Array[PackedInt32Array] = []
	for i in cuts.size() + 1:
		pieces.append(PackedInt32Array())
	for vertex in scene.vertex_count:
		var at := 0
		var cut: _Cut = null if cuts.is_empty() else cuts[0]
		while cut != null:
			var beyond := scene.isoline_coordinates[vertex * fields + cut.field] > cut.coordinate
			at = cut.piece_beyond if beyond else at
			cut = cut.next_beyond if beyond else cut.next
		pieces[at].append(vertex)
	var filled: Array[PackedInt32Array] = []
	for vertices in pieces:
		if not vertices.is_empty():
			filled.append(vertices)
	return filled


## Repeatedly cut the piece with the greatest spread of coordinates at its middle, using samples of the vertices.
static func _cuts(scene: Scene) -> Array[_Cut]:
	var samples := PackedInt32Array(range(0, scene.vertex_count, ceili(float(scene.vertex_count) / _SAMPLE_COUNT)))
	var pieces: Array[PackedInt32Array] = [samples]
	var best: Array[_Cut] = [_best_cut(scene, samples)]
	var last: Array[_Cut] = [null]  # the cut that made each piece
	var cuts: Array[_Cut] = []
	while pieces.size() < _PIECE_COUNT:
		var most := 0
		for i in best.size():
			if best[i].spread > best[most].spread:
				most = i
		var cut := best[most]
		if cut.spread <= _MIN_SPREAD:
			break
		var halves: Array[PackedInt32Array] = [PackedInt32Array(), PackedInt32Array()]
		for vertex in pieces[most]:
			halves[int(scene.isoline_coordinates[vertex * scene.field_count + cut.field] > cut.coordinate)].append(
				vertex
			)
		cut.piece_beyond = pieces.size()
		if last[most] != null:
			last[most].follow(most, cut)
		cuts.append(cut)
		pieces[most] = halves[0]
		best[most] = _best_cut(scene, halves[0])
		last[most] = cut
		pieces.append(halves[1])
		best.append(_best_cut(scene, halves[1]))
		last.append(cut)
	return cuts


## Return the cut in the field with the greatest spread of coordinates of these vertices.
static func _best_cut(scene: Scene, vertices: PackedInt32Array) -> _Cut:
	var best := _Cut.new()
	for field in scene.field_count:
		var interval := _range(scene, vertices, field)
		var spread := (interval.y - interval.x) * scene.weights[field]
		if spread > best.spread:
			best.spread = spread
			best.field = field
			best.coordinate = (interval.x + interval.y) / 2.0
	return best


## Return the least and greatest coordinate of these vertices in a field.
static func _range(scene: Scene, vertices: PackedInt32Array, field: int) -> Vector2:
	var low := INF
	var high := -INF
	var fields := scene.field_count
	for vertex in vertices:
		var coordinate := scene.isoline_coordinates[vertex * fields + field]
		low = minf(low, coordinate)
		high = maxf(high, coordinate)
	var top := scene.isoline_count - 1.0
	return Vector2(clampf(low, 0.0, top), clampf(high, 0.0, top))


## Return a piece that consists of some vertices.
static func make_piece(scene: Scene, vertices: PackedInt32Array) -> Piece:
	var piece := Piece.new()
	var low := Vector3.INF
	var high := -Vector3.INF
	for vertex in vertices:
		var lowest := scene.positions[vertex]
		var highest := lowest
		for target in scene.displacement_count:
			var moved := scene.displacements[target * scene.vertex_count + vertex]
			lowest += moved.min(Vector3.ZERO)
			highest += moved.max(Vector3.ZERO)
		low = low.min(lowest)
		high = high.max(highest)
	piece.box = AABB(low, high - low)
	for field in scene.field_count:
		var base := field * scene.isoline_count
		var weight := scene.weights[field]
		var interval := _range(scene, vertices, field)
		var middle := (interval.x + interval.y) / 2.0
		var lower := mini(int(middle), scene.isoline_count - 2)
		piece.isolines.append_array([base + lower, base + lower + 1])
		piece.shares.append_array([weight * (lower + 1 - middle), weight * (middle - lower)])
		var count := 0
		for gap in scene.isoline_count - 1:
			var below := minf(gap + 1, middle) - maxf(gap, interval.x)
			var above := minf(gap + 1, interval.y) - maxf(gap, middle)
			if maxf(below, above) > _MIN_SPREAD:
				piece.gaps.append(base + gap)
				piece.below.append(weight * maxf(below, 0.0))
				piece.above.append(weight * maxf(above, 0.0))
				count += 1
		if count > 0:
			piece.counts.append(count)
	return piece
