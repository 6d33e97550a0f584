extends RefCounted
## A box around a character that is computed on the graphics card, at a cost that does not depend on its vertices.
##
## Each field puts a vertex between where the transforms of two isolines put it, and the weights of the fields add up
## to 1. For vertices that lie between the same isolines at nearly the same places, the transform of the places in the
## middle says where they are, but for what the transforms change over the rest of the places. A single transform may
## be far from where the character is; their mean is not, and their changes are small over a small piece.

const Scene := preload("../wire/scene.gd")

## Floats of a transform.
const _TRANSFORM := 12
## Pieces that the character is divided into.
const _PIECES := 48
## Vertices that decide where they are divided.
const _LOOKED_AT := 2000
## Spread of places, in isolines, that is none.
const _NONE := 1e-6

var _pieces: Array[_Piece] = []
## The columns of each transform.
var _x := PackedVector3Array()
var _y := PackedVector3Array()
var _z := PackedVector3Array()
var _origin := PackedVector3Array()


## Vertices that lie at nearly the same places between the isolines of all fields.
class _Piece:
	var center: Vector3
	var half: Vector3
	## The transforms whose mean is that of the middle, and the share of each.
	var isolines := PackedInt32Array()
	var shares := PackedFloat32Array()
	## Gaps between two isolines over which places spread, each named by the lower one.
	var gaps := PackedInt32Array()
	## How far places spread in each gap, below and above the middle, times the weight of the field.
	var below := PackedFloat32Array()
	var above := PackedFloat32Array()
	## Number of gaps of each field.
	var counts := PackedInt32Array()


## The places of a field beyond some place are a piece of their own.
class _Cut:
	var field := 0
	var place := 0.0
	## How far the places spread that it divides, times the weight of the field.
	var spread := 0.0
	var piece_beyond := 0
	## The cuts that come after, on this side of it and beyond.
	var next: _Cut = null
	var next_beyond: _Cut = null

	## Let a cut of one of the two pieces come after this one.
	func follow(piece: int, cut: _Cut) -> void:
		if piece == piece_beyond:
			next_beyond = cut
		else:
			next = cut


func _init(scene: Scene) -> void:
	for vertices in _divided(scene):
		_pieces.append(_piece(scene, vertices))


## Return a box that no vertex leaves, for the controls of a frame: 3 × 4 floats a transform, row by row.
func around(controls: PackedByteArray) -> AABB:
	_read(controls.to_float32_array())
	var low := Vector3.INF
	var high := -Vector3.INF
	for piece in _pieces:
		var x := Vector3.ZERO
		var y := Vector3.ZERO
		var z := Vector3.ZERO
		var middle := Vector3.ZERO
		for i in piece.isolines.size():
			var share := piece.shares[i]
			var isoline := piece.isolines[i]
			x += share * _x[isoline]
			y += share * _y[isoline]
			z += share * _z[isoline]
			middle += share * _origin[isoline]
		var center := piece.center
		var half := piece.half
		middle += x * center.x + y * center.y + z * center.z
		var reach := x.abs() * half.x + y.abs() * half.y + z.abs() * half.z + _spread(piece)
		low = low.min(middle - reach)
		high = high.max(middle + reach)
	return AABB(low, high - low)


## Return how far the vertices of a piece are at most from where the transform of the middle puts them.
func _spread(piece: _Piece) -> Vector3:
	var center := piece.center
	var half := piece.half
	var spread := Vector3.ZERO
	var entry := 0
	for count in piece.counts:
		var below := Vector3.ZERO
		var above := Vector3.ZERO
		for _i in count:
			var gap := piece.gaps[entry]
			var x := _x[gap + 1] - _x[gap]
			var y := _y[gap + 1] - _y[gap]
			var z := _z[gap + 1] - _z[gap]
			var moved := _origin[gap + 1] - _origin[gap] + x * center.x + y * center.y + z * center.z
			var change := moved.abs() + x.abs() * half.x + y.abs() * half.y + z.abs() * half.z
			below += piece.below[entry] * change
			above += piece.above[entry] * change
			entry += 1
		spread += below.max(above)
	return spread


func _read(numbers: PackedFloat32Array) -> void:
	var count := numbers.size() / _TRANSFORM
	for columns: PackedVector3Array in [_x, _y, _z, _origin]:
		columns.resize(count)
	for i in count:
		var at := i * _TRANSFORM
		_x[i] = Vector3(numbers[at], numbers[at + 4], numbers[at + 8])
		_y[i] = Vector3(numbers[at + 1], numbers[at + 5], numbers[at + 9])
		_z[i] = Vector3(numbers[at + 2], numbers[at + 6], numbers[at + 10])
		_origin[i] = Vector3(numbers[at + 3], numbers[at + 7], numbers[at + 11])


## Divide the vertices into pieces, by the cuts that suit some of them.
static func _divided(scene: Scene) -> Array[PackedInt32Array]:
	var cuts := _cuts(scene)
	var fields := scene.field_count
	var pieces: Array[PackedInt32Array] = []
	for i in cuts.size() + 1:
		pieces.append(PackedInt32Array())
	for vertex in scene.vertex_count:
		var at := 0
		var cut: _Cut = null if cuts.is_empty() else cuts[0]
		while cut != null:
			var beyond := scene.ladder[vertex * fields + cut.field] > cut.place
			at = cut.piece_beyond if beyond else at
			cut = cut.next_beyond if beyond else cut.next
		pieces[at].append(vertex)
	var filled: Array[PackedInt32Array] = []
	for vertices in pieces:
		if not vertices.is_empty():
			filled.append(vertices)
	return filled


## Cut the piece whose places spread most at the middle of them, again and again, for some of the vertices.
static func _cuts(scene: Scene) -> Array[_Cut]:
	var some := PackedInt32Array(range(0, scene.vertex_count, ceili(float(scene.vertex_count) / _LOOKED_AT)))
	var pieces: Array[PackedInt32Array] = [some]
	var best: Array[_Cut] = [_best_cut(scene, some)]
	var last: Array[_Cut] = [null]  # the cut that made each piece
	var cuts: Array[_Cut] = []
	while pieces.size() < _PIECES:
		var most := 0
		for i in best.size():
			if best[i].spread > best[most].spread:
				most = i
		var cut := best[most]
		if cut.spread <= _NONE:
			break
		var halves: Array[PackedInt32Array] = [PackedInt32Array(), PackedInt32Array()]
		for vertex in pieces[most]:
			halves[int(scene.ladder[vertex * scene.field_count + cut.field] > cut.place)].append(vertex)
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


## Return the cut of the field in which the places of some vertices spread most.
static func _best_cut(scene: Scene, vertices: PackedInt32Array) -> _Cut:
	var best := _Cut.new()
	for field in scene.field_count:
		var places := _range(scene, vertices, field)
		var spread := (places.y - places.x) * scene.weights[field]
		if spread > best.spread:
			best.spread = spread
			best.field = field
			best.place = (places.x + places.y) / 2.0
	return best


## Return the least and greatest place of some vertices in a field.
static func _range(scene: Scene, vertices: PackedInt32Array, field: int) -> Vector2:
	var low := INF
	var high := -INF
	var fields := scene.field_count
	for vertex in vertices:
		var place := scene.ladder[vertex * fields + field]
		low = minf(low, place)
		high = maxf(high, place)
	var top := scene.isoline_count - 1.0
	return Vector2(clampf(low, 0.0, top), clampf(high, 0.0, top))


static func _piece(scene: Scene, vertices: PackedInt32Array) -> _Piece:
	var piece := _Piece.new()
	var low := Vector3.INF
	var high := -Vector3.INF
	for vertex in vertices:
		low = low.min(scene.positions[vertex])
		high = high.max(scene.positions[vertex])
	piece.center = (low + high) / 2.0
	piece.half = (high - low) / 2.0
	for field in scene.field_count:
		var base := field * scene.isoline_count
		var weight := scene.weights[field]
		var places := _range(scene, vertices, field)
		var middle := (places.x + places.y) / 2.0
		var lower := mini(int(middle), scene.isoline_count - 2)
		piece.isolines.append_array([base + lower, base + lower + 1])
		piece.shares.append_array([weight * (lower + 1 - middle), weight * (middle - lower)])
		var count := 0
		for gap in scene.isoline_count - 1:
			var below := minf(gap + 1, middle) - maxf(gap, places.x)
			var above := minf(gap + 1, places.y) - maxf(gap, middle)
			if maxf(below, above) > _NONE:
				piece.gaps.append(base + gap)
				piece.below.append(weight * maxf(below, 0.0))
				piece.above.append(weight * maxf(above, 0.0))
				count += 1
		if count > 0:
			piece.counts.append(count)
	return piece
