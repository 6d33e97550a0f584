using System.Runtime.InteropServices;

namespace Puppetline.Protocol
{
    /// <summary>Coordinate system and winding order of triangles.</summary>
    public enum Axes
    {
        /// <summary>File coordinates: right-handed, counter-clockwise triangles.</summary>
        File,

        /// <summary>Unity's coordinates: x negated, left-handed, clockwise triangles.</summary>
        Unity,
    }

    /// <summary>A vertex in the layout of the vertex buffer.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SurfaceVertex
    {
        /// <summary>Position, x.</summary>
        public float X;

        /// <summary>Position, y.</summary>
        public float Y;

        /// <summary>Position, z.</summary>
        public float Z;

        /// <summary>Unit normal, x; all three are zero if the normal is undefined.</summary>
        public float NormalX;

        /// <summary>Unit normal, y.</summary>
        public float NormalY;

        /// <summary>Unit normal, z.</summary>
        public float NormalZ;
    }

    /// <summary>An axis-aligned bounding box.</summary>
    public struct Box
    {
        /// <summary>The lowest x.</summary>
        public float LowX;

        /// <summary>The lowest y.</summary>
        public float LowY;

        /// <summary>The lowest z.</summary>
        public float LowZ;

        /// <summary>The highest x.</summary>
        public float HighX;

        /// <summary>The highest y.</summary>
        public float HighY;

        /// <summary>The highest z.</summary>
        public float HighZ;

        /// <summary>An empty box.</summary>
        public static Box Nothing => new Box
        {
            LowX = float.PositiveInfinity,
            LowY = float.PositiveInfinity,
            LowZ = float.PositiveInfinity,
            HighX = float.NegativeInfinity,
            HighY = float.NegativeInfinity,
            HighZ = float.NegativeInfinity,
        };

        /// <summary>Whether the box is empty.</summary>
        public bool IsEmpty => !(LowX <= HighX);

        /// <summary>Extend the box to a point.</summary>
        public void Add(float x, float y, float z)
        {
            // Math.Min and Math.Max take twice as long.
            if (x < LowX) { LowX = x; }
            if (x > HighX) { HighX = x; }
            if (y < LowY) { LowY = y; }
            if (y > HighY) { HighY = y; }
            if (z < LowZ) { LowZ = z; }
            if (z > HighZ) { HighZ = z; }
        }

        /// <summary>Convert the box from file coordinates.</summary>
        public Box In(Axes axes)
        {
            Box turned = this;
            if (axes == Axes.Unity)
            {
                turned.LowX = -HighX;
                turned.HighX = -LowX;
            }
            return turned;
        }
    }

    /// <summary>Functions that convert surfaces.</summary>
    public static class Surface
    {
        /// <summary>Convert positions and normals in file coordinates, n × 3 each, to vertices.</summary>
        /// <param name="positions">The array of positions.</param>
        /// <param name="normals">The array of normals, which are normalised; it can be the same array.</param>
        /// <param name="normalsStart">Index of the first normal's x.</param>
        /// <param name="axes">The axes of the result.</param>
        /// <param name="vertices">Receives n vertices.</param>
        /// <returns>The bounding box of the vertices.</returns>
        public static Box Write(float[] positions, float[] normals, int normalsStart, Axes axes, SurfaceVertex[] vertices)
        {
            Box box = Box.Nothing;
            float sign = axes == Axes.Unity ? -1 : 1;
            for (int v = 0; v < vertices.Length; v++)
            {
                int at = 3 * v, normal = normalsStart + at;
                float x = normals[normal], y = normals[normal + 1], z = normals[normal + 2];
                float scale = OneOver(x * x + y * y + z * z);
                vertices[v].X = sign * positions[at];
                vertices[v].Y = positions[at + 1];
                vertices[v].Z = positions[at + 2];
                vertices[v].NormalX = sign * x * scale;
                vertices[v].NormalY = y * scale;
                vertices[v].NormalZ = z * scale;
                box.Add(vertices[v].X, vertices[v].Y, vertices[v].Z);
            }
            return box;
        }

        /// <summary>Return the factor that normalises a vector with this squared length; 0 for a length of 0.</summary>
        internal static float OneOver(float squared)
        {
            return squared > 0 ? 1 / (float)System.Math.Sqrt(squared) : 0;
        }

        /// <summary>Return triangles with the opposite winding order.</summary>
        public static int[] TurnedOver(int[] triangles)
        {
            var turned = (int[])triangles.Clone();
            for (int i = 0; i + 2 < turned.Length; i += 3)
            {
                turned[i + 1] = triangles[i + 2];
                turned[i + 2] = triangles[i + 1];
            }
            return turned;
        }
    }
}
