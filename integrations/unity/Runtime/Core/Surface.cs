using System.Runtime.InteropServices;

namespace Puppetline
{
    /// <summary>Which way axes and triangles go.</summary>
    public enum Axes
    {
        /// <summary>As the character's file: right-handed, counter-clockwise triangles.</summary>
        File,

        /// <summary>As Unity: x negated, left-handed, clockwise triangles.</summary>
        Unity,
    }

    /// <summary>A vertex as it lies in a vertex buffer.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SurfaceVertex
    {
        /// <summary>Its position, x.</summary>
        public float X;

        /// <summary>Its position, y.</summary>
        public float Y;

        /// <summary>Its position, z.</summary>
        public float Z;

        /// <summary>Its unit normal, x; all zero if it has no direction.</summary>
        public float NormalX;

        /// <summary>Its unit normal, y.</summary>
        public float NormalY;

        /// <summary>Its unit normal, z.</summary>
        public float NormalZ;
    }

    /// <summary>A box around something, empty to begin with.</summary>
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

        /// <summary>A box with nothing in it.</summary>
        public static Box Nothing => new Box
        {
            LowX = float.PositiveInfinity,
            LowY = float.PositiveInfinity,
            LowZ = float.PositiveInfinity,
            HighX = float.NegativeInfinity,
            HighY = float.NegativeInfinity,
            HighZ = float.NegativeInfinity,
        };

        /// <summary>Whether nothing is in it.</summary>
        public bool IsEmpty => !(LowX <= HighX);

        /// <summary>Take in a point.</summary>
        public void Add(float x, float y, float z)
        {
            // on doubles, Math.Min and Max would be twice the work
            if (x < LowX) { LowX = x; }
            if (x > HighX) { HighX = x; }
            if (y < LowY) { LowY = y; }
            if (y > HighY) { HighY = y; }
            if (z < LowZ) { LowZ = z; }
            if (z > HighZ) { HighZ = z; }
        }

        /// <summary>Return the same box in other axes than the file's.</summary>
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

    /// <summary>What there is to do with surfaces that came ready for drawing.</summary>
    public static class Surface
    {
        /// <summary>Turn positions and normals in file coordinates, n × 3 each, into vertices.</summary>
        /// <param name="positions">The array that holds positions.</param>
        /// <param name="normals">The array that holds normals, which are brought to length 1; may be the same.</param>
        /// <param name="normalsStart">Where the normals begin in it.</param>
        /// <param name="axes">Which axes the vertices are to have.</param>
        /// <param name="vertices">Receives n vertices.</param>
        /// <returns>The box around them.</returns>
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

        /// <summary>Return what a vector of this squared length is to be multiplied by; zero stays zero.</summary>
        internal static float OneOver(float squared)
        {
            return squared > 0 ? 1 / (float)System.Math.Sqrt(squared) : 0;
        }

        /// <summary>Return triangles, three vertices each, with the side in front that was behind.</summary>
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
