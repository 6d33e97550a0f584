using System;

namespace Puppetline.Protocol
{
    /// <summary>How normals are computed from controls.</summary>
    public enum NormalsBy
    {
        /// <summary>Exact normals of the surface, by the slopes of isoline coordinates.</summary>
        Slopes,

        /// <summary>Rest normals rotated by the blended transform: faster, some degrees off where limbs bend.</summary>
        Cofactors,
    }

    /// <summary>Evaluates controls on the CPU. It is not thread-safe and allocates memory only in its constructor.</summary>
    public sealed class Deformation
    {
        /// <summary>Number of values in an affine transform, stored row by row: [linear | translation].</summary>
        public const int TransformSize = 12;

        readonly Scene scene;
        readonly float[] rest;

        /// <summary>For each vertex and field: index of the first value of the lower one of its two transforms.</summary>
        readonly int[] lower;

        /// <summary>For each vertex and field: weight of the upper transform, and the two slopes.</summary>
        readonly float[] along;

        /// <summary>For each vertex: the first of two tangents; the second one is perpendicular to it and the normal.</summary>
        readonly float[] tangents;

        /// <summary>The transforms multiplied by the weights of their fields.</summary>
        readonly float[] weighted;

        /// <summary>Difference of each weighted transform to the next one.</summary>
        readonly float[] steps;

        /// <summary>Prepare the evaluation of a character.</summary>
        /// <param name="scene">The character.</param>
        /// <param name="rest">Its positions at rest, n × 3, which may change between evaluations; null for those of the scene.</param>
        public Deformation(Scene scene, float[] rest = null)
        {
            this.scene = scene;
            this.rest = rest ?? scene.Positions;
            int n = scene.VertexCount, fields = scene.FieldCount;
            lower = new int[n * fields];
            along = new float[3 * n * fields];
            for (int i = 0; i < lower.Length; i++)
            {
                float coordinate = scene.IsolineCoordinates[i];
                int k = Math.Min((int)coordinate, scene.IsolineCount - 2);
                lower[i] = (i % fields * scene.IsolineCount + k) * TransformSize;
                along[3 * i] = coordinate - k;
                along[3 * i + 1] = scene.Slopes[2 * i];
                along[3 * i + 2] = scene.Slopes[2 * i + 1];
            }
            tangents = Tangents(scene.Normals);
            weighted = new float[scene.ControlCount];
            steps = new float[scene.ControlCount];
        }

        /// <summary>Evaluate all vertices.</summary>
        /// <param name="controls"><see cref="Scene.ControlCount"/> numbers.</param>
        /// <param name="normals">How to compute normals.</param>
        /// <param name="axes">The axes of the result.</param>
        /// <param name="vertices">Receives all vertices of the scene.</param>
        /// <returns>The bounding box of the vertices.</returns>
        public Box Evaluate(float[] controls, NormalsBy normals, Axes axes, SurfaceVertex[] vertices)
        {
            Weigh(controls);
            return normals == NormalsBy.Slopes ? BySlopes(axes, vertices) : ByCofactors(axes, vertices);
        }

        void Weigh(float[] controls)
        {
            int perField = scene.IsolineCount * TransformSize;
            for (int i = 0; i < weighted.Length; i++)
            {
                weighted[i] = controls[i] * scene.Weights[i / perField];
            }
            for (int i = 0; i + TransformSize < steps.Length; i++)
            {
                steps[i] = weighted[i + TransformSize] - weighted[i];
            }
        }

        Box BySlopes(Axes axes, SurfaceVertex[] vertices)
        {
            Box box = Box.Nothing;
            float[] T = weighted, D = steps, restNormals = scene.Normals;
            float sign = axes == Axes.Unity ? -1 : 1;
            int fields = scene.FieldCount;
            for (int v = 0, p = 0; v < vertices.Length; v++)
            {
                float x = rest[3 * v], y = rest[3 * v + 1], z = rest[3 * v + 2];
                float b00 = 0, b01 = 0, b02 = 0, b03 = 0, b10 = 0, b11 = 0, b12 = 0, b13 = 0, b20 = 0, b21 = 0, b22 = 0, b23 = 0;
                float a0 = 0, a1 = 0, a2 = 0, c0 = 0, c1 = 0, c2 = 0;
                for (int i = 0; i < fields; i++, p++)
                {
                    int t = lower[p];
                    float f = along[3 * p], s = along[3 * p + 1], r = along[3 * p + 2];
                    float d0 = D[t], d1 = D[t + 1], d2 = D[t + 2], d3 = D[t + 3];
                    float moved = d0 * x + d1 * y + d2 * z + d3;
                    b00 += T[t] + f * d0;
                    b01 += T[t + 1] + f * d1;
                    b02 += T[t + 2] + f * d2;
                    b03 += T[t + 3] + f * d3;
                    a0 += s * moved;
                    c0 += r * moved;
                    d0 = D[t + 4];
                    d1 = D[t + 5];
                    d2 = D[t + 6];
                    d3 = D[t + 7];
                    moved = d0 * x + d1 * y + d2 * z + d3;
                    b10 += T[t + 4] + f * d0;
                    b11 += T[t + 5] + f * d1;
                    b12 += T[t + 6] + f * d2;
                    b13 += T[t + 7] + f * d3;
                    a1 += s * moved;
                    c1 += r * moved;
                    d0 = D[t + 8];
                    d1 = D[t + 9];
                    d2 = D[t + 10];
                    d3 = D[t + 11];
                    moved = d0 * x + d1 * y + d2 * z + d3;
                    b20 += T[t + 8] + f * d0;
                    b21 += T[t + 9] + f * d1;
                    b22 += T[t + 10] + f * d2;
                    b23 += T[t + 11] + f * d3;
                    a2 += s * moved;
                    c2 += r * moved;
                }
                float ax = tangents[3 * v], ay = tangents[3 * v + 1], az = tangents[3 * v + 2];
                float nx = restNormals[3 * v], ny = restNormals[3 * v + 1], nz = restNormals[3 * v + 2];
                float bx = ny * az - nz * ay, by = nz * ax - nx * az, bz = nx * ay - ny * ax;
                a0 += b00 * ax + b01 * ay + b02 * az;
                a1 += b10 * ax + b11 * ay + b12 * az;
                a2 += b20 * ax + b21 * ay + b22 * az;
                c0 += b00 * bx + b01 * by + b02 * bz;
                c1 += b10 * bx + b11 * by + b12 * bz;
                c2 += b20 * bx + b21 * by + b22 * bz;
                nx = a1 * c2 - a2 * c1;
                ny = a2 * c0 - a0 * c2;
                nz = a0 * c1 - a1 * c0;
                float scale = Surface.OneOver(nx * nx + ny * ny + nz * nz);
                vertices[v].X = sign * (b00 * x + b01 * y + b02 * z + b03);
                vertices[v].Y = b10 * x + b11 * y + b12 * z + b13;
                vertices[v].Z = b20 * x + b21 * y + b22 * z + b23;
                vertices[v].NormalX = sign * nx * scale;
                vertices[v].NormalY = ny * scale;
                vertices[v].NormalZ = nz * scale;
                box.Add(vertices[v].X, vertices[v].Y, vertices[v].Z);
            }
            return box;
        }

        Box ByCofactors(Axes axes, SurfaceVertex[] vertices)
        {
            Box box = Box.Nothing;
            float[] T = weighted, D = steps, restNormals = scene.Normals;
            float sign = axes == Axes.Unity ? -1 : 1;
            int fields = scene.FieldCount;
            for (int v = 0, p = 0; v < vertices.Length; v++)
            {
                float b00 = 0, b01 = 0, b02 = 0, b03 = 0, b10 = 0, b11 = 0, b12 = 0, b13 = 0, b20 = 0, b21 = 0, b22 = 0, b23 = 0;
                for (int i = 0; i < fields; i++, p++)
                {
                    int t = lower[p];
                    float f = along[3 * p];
                    b00 += T[t] + f * D[t];
                    b01 += T[t + 1] + f * D[t + 1];
                    b02 += T[t + 2] + f * D[t + 2];
                    b03 += T[t + 3] + f * D[t + 3];
                    b10 += T[t + 4] + f * D[t + 4];
                    b11 += T[t + 5] + f * D[t + 5];
                    b12 += T[t + 6] + f * D[t + 6];
                    b13 += T[t + 7] + f * D[t + 7];
                    b20 += T[t + 8] + f * D[t + 8];
                    b21 += T[t + 9] + f * D[t + 9];
                    b22 += T[t + 10] + f * D[t + 10];
                    b23 += T[t + 11] + f * D[t + 11];
                }
                float nx = restNormals[3 * v], ny = restNormals[3 * v + 1], nz = restNormals[3 * v + 2];
                float m0 = (b11 * b22 - b12 * b21) * nx + (b12 * b20 - b10 * b22) * ny + (b10 * b21 - b11 * b20) * nz;
                float m1 = (b02 * b21 - b01 * b22) * nx + (b00 * b22 - b02 * b20) * ny + (b01 * b20 - b00 * b21) * nz;
                float m2 = (b01 * b12 - b02 * b11) * nx + (b02 * b10 - b00 * b12) * ny + (b00 * b11 - b01 * b10) * nz;
                float scale = Surface.OneOver(m0 * m0 + m1 * m1 + m2 * m2);
                float x = rest[3 * v], y = rest[3 * v + 1], z = rest[3 * v + 2];
                vertices[v].X = sign * (b00 * x + b01 * y + b02 * z + b03);
                vertices[v].Y = b10 * x + b11 * y + b12 * z + b13;
                vertices[v].Z = b20 * x + b21 * y + b22 * z + b23;
                vertices[v].NormalX = sign * m0 * scale;
                vertices[v].NormalY = m1 * scale;
                vertices[v].NormalZ = m2 * scale;
                box.Add(vertices[v].X, vertices[v].Y, vertices[v].Z);
            }
            return box;
        }

        /// <summary>
        /// Return the first tangent of slopes for each normal n: normalise(e × n), where e is the axis with the smallest |n|.
        /// </summary>
        static float[] Tangents(float[] normals)
        {
            var tangents = new float[normals.Length];
            for (int i = 0; i < normals.Length; i += 3)
            {
                float x = normals[i], y = normals[i + 1], z = normals[i + 2];
                float ax = Math.Abs(x), ay = Math.Abs(y), az = Math.Abs(z);
                if (ax <= ay && ax <= az)
                {
                    Set(tangents, i, 0, -z, y);
                }
                else if (ay <= az)
                {
                    Set(tangents, i, z, 0, -x);
                }
                else
                {
                    Set(tangents, i, -y, x, 0);
                }
            }
            return tangents;
        }

        static void Set(float[] to, int at, float x, float y, float z)
        {
            float scale = Surface.OneOver(x * x + y * y + z * z);
            to[at] = x * scale;
            to[at + 1] = y * scale;
            to[at + 2] = z * scale;
        }
    }
}
