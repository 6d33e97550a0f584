using System;
using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>A point of a moving character and its orientation: two axes, which are not normalised.</summary>
    public struct PatchPose
    {
        /// <summary>x of the point.</summary>
        public float X;

        /// <summary>y of the point.</summary>
        public float Y;

        /// <summary>z of the point.</summary>
        public float Z;

        /// <summary>x of the first axis.</summary>
        public float FirstX;

        /// <summary>y of the first axis.</summary>
        public float FirstY;

        /// <summary>z of the first axis.</summary>
        public float FirstZ;

        /// <summary>x of the front axis.</summary>
        public float FrontX;

        /// <summary>y of the front axis.</summary>
        public float FrontY;

        /// <summary>z of the front axis.</summary>
        public float FrontZ;
    }

    /// <summary>
    /// A few vertices around a point of a character, which determine where the point moves and how it turns.
    ///
    /// Point and axes are linear in the positions of the vertices, so that a frame takes a few sums, whatever the size of
    /// the mesh. The front axis is at a right angle to the normal of the surface, or to the limb, and as close as possible
    /// to the character's front at rest (to its up where these are almost parallel). The first axis is the limb's
    /// direction; on the surface, it is the cross product of normal and front axis.
    /// </summary>
    public sealed class SurfacePatch
    {
        const int MaxVertices = 32;

        /// <summary>Radius of the vertices around a point of a limb, relative to the distance of the nearest one.</summary>
        const double Radius = 1.4;

        /// <summary>Length of the projected front below which up defines the orientation.</summary>
        const double MinProjection = 0.3;

        /// <summary>Squared distance, relative to the largest, added to each axis: a flat patch has no extent along one.</summary>
        const double Regularization = 1e-4;

        readonly Scene scene;
        readonly int[] vertices;

        /// <summary>Weights of the vertices for the point and for the two axes, three per vertex.</summary>
        readonly double[] weights;

        SurfacePatch(Scene scene, List<int> vertices, double[] origin, double[] first, double[] front, bool inLimb)
        {
            this.scene = scene;
            this.vertices = vertices.ToArray();
            InLimb = inLimb;
            weights = Fit(origin, first, Cross(front, first), front);
        }

        /// <summary>Whether the first axis is the direction of a limb, and not an axis of the surface.</summary>
        public bool InLimb { get; }

        /// <summary>Make the patch around a vertex, whose position is the point.</summary>
        /// <exception cref="ArgumentOutOfRangeException">The scene does not have this vertex.</exception>
        public static SurfacePatch AtVertex(Scene scene, int vertex)
        {
            if (vertex < 0 || vertex >= scene.VertexCount)
            {
                throw new ArgumentOutOfRangeException(nameof(vertex), vertex, "expected a vertex of the scene, which has " + scene.VertexCount);
            }
            double[] normal = Unit(Row(scene.Normals, vertex)) ?? Axis(scene, "up", 1);
            var around = new HashSet<int>(Neighbours(scene, Neighbours(scene, new HashSet<int> { vertex })));
            around.Remove(vertex);
            var ordered = new List<int> { vertex };
            ordered.AddRange(around);
            double[] front = Within(scene, normal);
            var patch = new SurfacePatch(scene, ordered, Row(scene.Positions, vertex), Cross(normal, front), front, false);
            for (int i = 0; i < ordered.Count; i++)
            {
                patch.weights[3 * i] = i == 0 ? 1 : 0;
            }
            return patch;
        }

        /// <summary>Make the patch around the vertex that is closest to a handle at rest.</summary>
        /// <returns>Null if the scene has no handle of this name.</returns>
        public static SurfacePatch AtHandle(Scene scene, string handle)
        {
            Json found = Named(scene.Description["handles"], handle);
            return found.Kind == JsonKind.Null ? null : AtVertex(scene, Nearest(scene, Point(found["position"])));
        }

        /// <summary>Make the patch around a point inside of a limb.</summary>
        /// <param name="scene">The character.</param>
        /// <param name="limb">Name of the limb.</param>
        /// <param name="share">Position along the limb: 0 at its root, 1 at its tip.</param>
        /// <returns>Null if the scene has no limb of this name.</returns>
        public static SurfacePatch InsideLimb(Scene scene, string limb, double share)
        {
            Json points = Named(scene.Description["limbs"], limb)["points"];
            if (points.Count < 2)
            {
                return null;
            }
            double left = 0;
            for (int i = 0; i + 1 < points.Count; i++)
            {
                left += share * Length(Minus(Point(points[i + 1]), Point(points[i])));
            }
            int bone = 0;
            double[] along = Minus(Point(points[1]), Point(points[0]));
            while (left > Length(along) && bone + 2 < points.Count)
            {
                left -= Length(along);
                bone++;
                along = Minus(Point(points[bone + 1]), Point(points[bone]));
            }
            double[] direction = Unit(along) ?? Axis(scene, "up", 1);
            double[] point = Plus(Point(points[bone]), direction, Math.Min(left, Length(along)));
            return new SurfacePatch(scene, Around(scene, point), point, direction, Within(scene, direction), true);
        }

        /// <summary>Compute the pose in a frame of controls or vertices.</summary>
        /// <param name="frame">The frame, of this scene.</param>
        /// <param name="axes">The axes of the result.</param>
        /// <param name="pose">Receives the pose.</param>
        /// <returns>False for a frame that does not contain positions.</returns>
        public bool TryEvaluate(Frame frame, Axes axes, out PatchPose pose)
        {
            pose = default;
            Kind kind = frame.Header.Kind;
            if (kind != Kind.Controls && kind != Kind.Vertices && kind != Kind.Vertices16)
            {
                return false;
            }
            double x = 0, y = 0, z = 0, firstX = 0, firstY = 0, firstZ = 0, frontX = 0, frontY = 0, frontZ = 0;
            for (int i = 0; i < vertices.Length; i++)
            {
                double px, py, pz;
                if (kind == Kind.Controls)
                {
                    Deform(frame.Values, vertices[i], out px, out py, out pz);
                }
                else
                {
                    int at = 3 * vertices[i];
                    px = frame.Values[at];
                    py = frame.Values[at + 1];
                    pz = frame.Values[at + 2];
                }
                double origin = weights[3 * i], first = weights[3 * i + 1], front = weights[3 * i + 2];
                x += origin * px;
                y += origin * py;
                z += origin * pz;
                firstX += first * px;
                firstY += first * py;
                firstZ += first * pz;
                frontX += front * px;
                frontY += front * py;
                frontZ += front * pz;
            }
            float sign = axes == Axes.Unity ? -1 : 1;
            pose = new PatchPose
            {
                X = sign * (float)x, Y = (float)y, Z = (float)z,
                FirstX = sign * (float)firstX, FirstY = (float)firstY, FirstZ = (float)firstZ,
                FrontX = sign * (float)frontX, FrontY = (float)frontY, FrontZ = (float)frontZ,
            };
            return true;
        }

        void Deform(float[] controls, int vertex, out double x, out double y, out double z)
        {
            float[] rest = scene.Positions;
            double px = rest[3 * vertex], py = rest[3 * vertex + 1], pz = rest[3 * vertex + 2];
            x = y = z = 0;
            for (int field = 0; field < scene.FieldCount; field++)
            {
                double coordinate = scene.IsolineCoordinates[vertex * scene.FieldCount + field];
                int k = Math.Min((int)coordinate, scene.IsolineCount - 2);
                for (int step = 0; step < 2; step++)
                {
                    double share = scene.Weights[field] * (step == 0 ? 1 - (coordinate - k) : coordinate - k);
                    int t = (field * scene.IsolineCount + k + step) * Deformation.TransformSize;
                    x += share * (controls[t] * px + controls[t + 1] * py + controls[t + 2] * pz + controls[t + 3]);
                    y += share * (controls[t + 4] * px + controls[t + 5] * py + controls[t + 6] * pz + controls[t + 7]);
                    z += share * (controls[t + 8] * px + controls[t + 9] * py + controls[t + 10] * pz + controls[t + 11]);
                }
            }
        }

        /// <summary>Fit a linear map of the rest positions; return the weights of the vertices in the point and in two axes.</summary>
        double[] Fit(double[] origin, double[] first, double[] second, double[] front)
        {
            int n = vertices.Length;
            var offsets = new double[n][];
            var mean = new double[3];
            for (int i = 0; i < n; i++)
            {
                double[] offset = Minus(Row(scene.Positions, vertices[i]), origin);
                offsets[i] = new[] { Dot(offset, first), Dot(offset, second), Dot(offset, front) };
                mean = Plus(mean, offsets[i], 1.0 / n);
            }
            double extent = 1e-30;
            for (int i = 0; i < n; i++)
            {
                offsets[i] = Minus(offsets[i], mean);
                extent = Math.Max(extent, Length(offsets[i]));
            }
            var squares = new double[3][];
            for (int axis = 0; axis < 3; axis++)
            {
                squares[axis] = new double[3];
                squares[axis][axis] = Regularization;
                foreach (double[] offset in offsets)
                {
                    squares[axis] = Plus(squares[axis], offset, offset[axis] / (extent * extent));
                }
            }
            // The rows of the inverse of a symmetric matrix are cross products of its rows over its determinant.
            double determinant = Dot(squares[0], Cross(squares[1], squares[2]));
            var fitted = new double[3 * n];
            for (int i = 0; i < n; i++)
            {
                var slopes = new double[3];
                for (int axis = 0; axis < 3; axis++)
                {
                    double[] row = Cross(squares[(axis + 1) % 3], squares[(axis + 2) % 3]);
                    slopes[axis] = Dot(row, offsets[i]) / (determinant * extent * extent);
                }
                fitted[3 * i] = 1.0 / n - Dot(slopes, mean);
                fitted[3 * i + 1] = slopes[0];
                fitted[3 * i + 2] = slopes[2];
            }
            return fitted;
        }

        static Json Named(Json list, string name)
        {
            for (int i = 0; i < list.Count; i++)
            {
                if (list[i]["name"].Text == name)
                {
                    return list[i];
                }
            }
            return Json.Null;
        }

        /// <summary>Return the unit vector of an axis of the description, such as "y" or "-z".</summary>
        static double[] Axis(Scene scene, string key, int otherwise)
        {
            string text = scene.Description[key].Text;
            int axis = text.Length > 0 ? "xyz".IndexOf(text[text.Length - 1]) : otherwise;
            var unit = new double[3];
            unit[axis < 0 ? otherwise : axis] = text.StartsWith("-", StringComparison.Ordinal) ? -1 : 1;
            return unit;
        }

        /// <summary>Return the direction at a right angle to an axis that is closest to the character's front.</summary>
        static double[] Within(Scene scene, double[] axis)
        {
            double[] ahead = Axis(scene, "front", 2), up = Axis(scene, "up", 1);
            double turn = scene.Description["turn"].Number * Math.PI / 180;
            double[] front = Plus(Plus(new double[3], ahead, Math.Cos(turn)), Cross(up, ahead), Math.Sin(turn));
            double[] direction = Plus(front, axis, -Dot(front, axis));
            return Unit(Length(direction) >= MinProjection ? direction : Plus(up, axis, -Dot(up, axis)));
        }

        /// <summary>Return all vertices of the triangles that meet some vertices, or vertices at the same positions.</summary>
        static HashSet<int> Neighbours(Scene scene, HashSet<int> of)
        {
            var places = new HashSet<(float, float, float)>();
            foreach (int vertex in of)
            {
                places.Add(Place(scene, vertex));
            }
            var found = new HashSet<int>(of);
            for (int i = 0; i < scene.Triangles.Length; i += 3)
            {
                for (int corner = 0; corner < 3; corner++)
                {
                    if (places.Contains(Place(scene, scene.Triangles[i + corner])))
                    {
                        found.Add(scene.Triangles[i]);
                        found.Add(scene.Triangles[i + 1]);
                        found.Add(scene.Triangles[i + 2]);
                        break;
                    }
                }
            }
            return found;
        }

        /// <summary>Return the vertices near a point, at most <see cref="MaxVertices"/> of them, evenly chosen.</summary>
        static List<int> Around(Scene scene, double[] point)
        {
            double radius = Radius * Length(Minus(Row(scene.Positions, Nearest(scene, point)), point));
            var near = new List<int>();
            for (int vertex = 0; vertex < scene.VertexCount; vertex++)
            {
                if (Length(Minus(Row(scene.Positions, vertex), point)) <= radius)
                {
                    near.Add(vertex);
                }
            }
            var chosen = new List<int>();
            double step = Math.Max(1.0, near.Count / (double)MaxVertices);
            for (int i = 0; i < Math.Min(near.Count, MaxVertices); i++)
            {
                chosen.Add(near[(int)(i * step)]);
            }
            return chosen;
        }

        static int Nearest(Scene scene, double[] point)
        {
            int best = 0;
            double least = double.MaxValue;
            for (int vertex = 0; vertex < scene.VertexCount; vertex++)
            {
                double distance = Length(Minus(Row(scene.Positions, vertex), point));
                if (distance < least)
                {
                    least = distance;
                    best = vertex;
                }
            }
            return best;
        }

        static (float, float, float) Place(Scene scene, int vertex)
        {
            return (scene.Positions[3 * vertex], scene.Positions[3 * vertex + 1], scene.Positions[3 * vertex + 2]);
        }

        static double[] Row(float[] values, int row) => new double[] { values[3 * row], values[3 * row + 1], values[3 * row + 2] };

        static double[] Point(Json list) => new[] { list[0].Number, list[1].Number, list[2].Number };

        static double[] Plus(double[] a, double[] b, double factor)
        {
            return new[] { a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2] };
        }

        static double[] Minus(double[] a, double[] b) => Plus(a, b, -1);

        static double Dot(double[] a, double[] b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

        static double Length(double[] a) => Math.Sqrt(Dot(a, a));

        static double[] Unit(double[] a) => Length(a) > 0 ? Plus(new double[3], a, 1 / Length(a)) : null;

        static double[] Cross(double[] a, double[] b)
        {
            return new[] { a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0] };
        }
    }
}
