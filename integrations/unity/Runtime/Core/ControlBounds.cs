using System;
using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>
    /// Bounding box of a character that is evaluated elsewhere. Its cost does not depend on the number of vertices.
    /// Each field interpolates a vertex between the transforms of two isolines, and the weights of the fields add up to
    /// 1. The vertices are divided into pieces with similar isoline coordinates. The mean transform of a piece, at the
    /// middle of its coordinates, approximates the positions of its vertices. The change of the transforms over its
    /// coordinates bounds the error. A single transform can be far away from the character, but the mean is not, and the
    /// change is small within a small piece.
    /// </summary>
    public sealed class ControlBounds
    {
        /// <summary>Maximum number of pieces.</summary>
        const int PieceCount = 48;

        /// <summary>Minimum spread of isoline coordinates, in isolines; smaller ones count as zero.</summary>
        const float MinSpread = 1e-6f;

        readonly List<Piece> pieces = new List<Piece>();
        readonly float[] middle = new float[Deformation.TransformSize];
        readonly float[] below = new float[3], above = new float[3], reach = new float[3];

        /// <summary>Prepare the pieces of a character.</summary>
        public ControlBounds(Scene scene)
        {
            foreach (List<int> vertices in Divide(scene))
            {
                pieces.Add(new Piece(scene, vertices));
            }
        }

        /// <summary>Return a box that contains all vertices.</summary>
        public Box Of(float[] controls, Axes axes)
        {
            Box sum = Box.Nothing;
            foreach (Piece piece in pieces)
            {
                Array.Clear(middle, 0, middle.Length);
                foreach (Share share in piece.Middle)
                {
                    for (int i = 0; i < middle.Length; i++)
                    {
                        middle[i] += share.Weight * controls[share.Transform + i];
                    }
                }
                for (int row = 0; row < 3; row++)
                {
                    int t = 4 * row;
                    reach[row] = Math.Abs(middle[t]) * piece.HalfX + Math.Abs(middle[t + 1]) * piece.HalfY + Math.Abs(middle[t + 2]) * piece.HalfZ;
                }
                foreach (List<Gap> field in piece.Fields)
                {
                    AddSpread(piece, field, controls);
                }
                float x = At(piece, 0), y = At(piece, 4), z = At(piece, 8);
                sum.Add(x - reach[0], y - reach[1], z - reach[2]);
                sum.Add(x + reach[0], y + reach[1], z + reach[2]);
            }
            return sum.In(axes);
        }

        float At(Piece piece, int t) => middle[t] * piece.X + middle[t + 1] * piece.Y + middle[t + 2] * piece.Z + middle[t + 3];

        /// <summary>Add the maximum distance that a field moves the vertices of a piece from their mean positions.</summary>
        void AddSpread(Piece piece, List<Gap> field, float[] T)
        {
            for (int row = 0; row < 3; row++)
            {
                below[row] = above[row] = 0;
            }
            foreach (Gap gap in field)
            {
                for (int row = 0; row < 3; row++)
                {
                    int low = gap.Transform + 4 * row, high = low + Deformation.TransformSize;
                    float x = T[high] - T[low], y = T[high + 1] - T[low + 1], z = T[high + 2] - T[low + 2];
                    float moved = T[high + 3] - T[low + 3] + x * piece.X + y * piece.Y + z * piece.Z;
                    float change = Math.Abs(moved) + Math.Abs(x) * piece.HalfX + Math.Abs(y) * piece.HalfY + Math.Abs(z) * piece.HalfZ;
                    below[row] += gap.Below * change;
                    above[row] += gap.Above * change;
                }
            }
            for (int row = 0; row < 3; row++)
            {
                reach[row] += Math.Max(below[row], above[row]);
            }
        }

        /// <summary>Repeatedly cut the piece with the greatest spread of coordinates at its middle.</summary>
        static List<List<int>> Divide(Scene scene)
        {
            var all = new List<int>(scene.VertexCount);
            for (int v = 0; v < scene.VertexCount; v++)
            {
                all.Add(v);
            }
            var divided = new List<List<int>> { all };
            var cuts = new List<Cut> { new Cut(scene, all) };
            while (divided.Count < PieceCount)
            {
                int most = 0;
                for (int i = 1; i < cuts.Count; i++)
                {
                    most = cuts[i].Spread > cuts[most].Spread ? i : most;
                }
                if (!(cuts[most].Spread > MinSpread))
                {
                    break;
                }
                Cut cut = cuts[most];
                List<int> rest = divided[most].FindAll(v => !(scene.IsolineCoordinates[v * scene.FieldCount + cut.Field] > cut.Coordinate));
                List<int> beyond = divided[most].FindAll(v => scene.IsolineCoordinates[v * scene.FieldCount + cut.Field] > cut.Coordinate);
                divided[most] = rest;
                cuts[most] = new Cut(scene, rest);
                divided.Add(beyond);
                cuts.Add(new Cut(scene, beyond));
            }
            return divided.FindAll(vertices => vertices.Count > 0);
        }

        /// <summary>Find the least and greatest coordinate of these vertices in a field.</summary>
        static void Range(Scene scene, List<int> vertices, int field, out float low, out float high)
        {
            low = scene.IsolineCount - 1;
            high = 0;
            foreach (int v in vertices)
            {
                float coordinate = Math.Min(Math.Max(scene.IsolineCoordinates[v * scene.FieldCount + field], 0), scene.IsolineCount - 1);
                low = Math.Min(low, coordinate);
                high = Math.Max(high, coordinate);
            }
        }

        /// <summary>The middle of the coordinates of these vertices, in the field with the greatest spread.</summary>
        readonly struct Cut
        {
            public readonly int Field;
            public readonly float Coordinate, Spread;

            public Cut(Scene scene, List<int> vertices)
            {
                Field = 0;
                Coordinate = Spread = 0;
                for (int field = 0; field < scene.FieldCount; field++)
                {
                    Range(scene, vertices, field, out float low, out float high);
                    if ((high - low) * scene.Weights[field] > Spread)
                    {
                        Field = field;
                        Coordinate = (low + high) / 2;
                        Spread = (high - low) * scene.Weights[field];
                    }
                }
            }
        }

        /// <summary>A transform and its weight in a mean.</summary>
        readonly struct Share
        {
            public readonly int Transform;
            public readonly float Weight;

            public Share(int transform, float weight)
            {
                Transform = transform;
                Weight = weight;
            }
        }

        /// <summary>
        /// A gap between two isolines, given by the first one, and the spread of the coordinates in it below and above the
        /// middle, times the weight of the field.
        /// </summary>
        readonly struct Gap
        {
            public readonly int Transform;
            public readonly float Below, Above;

            public Gap(int transform, float below, float above)
            {
                Transform = transform;
                Below = below;
                Above = above;
            }
        }

        /// <summary>Vertices with similar isoline coordinates in all fields.</summary>
        sealed class Piece
        {
            public readonly float X, Y, Z, HalfX, HalfY, HalfZ;
            public readonly List<Share> Middle = new List<Share>();
            public readonly List<List<Gap>> Fields = new List<List<Gap>>();

            public Piece(Scene scene, List<int> vertices)
            {
                Box box = Box.Nothing;
                foreach (int v in vertices)
                {
                    Moved(scene, 3 * v, out float lowX, out float highX);
                    Moved(scene, 3 * v + 1, out float lowY, out float highY);
                    Moved(scene, 3 * v + 2, out float lowZ, out float highZ);
                    box.Add(lowX, lowY, lowZ);
                    box.Add(highX, highY, highZ);
                }
                X = (box.LowX + box.HighX) / 2;
                Y = (box.LowY + box.HighY) / 2;
                Z = (box.LowZ + box.HighZ) / 2;
                HalfX = (box.HighX - box.LowX) / 2;
                HalfY = (box.HighY - box.LowY) / 2;
                HalfZ = (box.HighZ - box.LowZ) / 2;
                for (int field = 0; field < scene.FieldCount; field++)
                {
                    Range(scene, vertices, field, out float low, out float high);
                    AddField(scene, field, low, high);
                }
            }

            /// <summary>Find the least and greatest value of a coordinate at rest, over all weights of the mesh's own targets.</summary>
            static void Moved(Scene scene, int coordinate, out float low, out float high)
            {
                low = high = scene.Positions[coordinate];
                for (int at = coordinate; scene.Displacements != null && at < scene.Displacements.Length; at += scene.Positions.Length)
                {
                    low += Math.Min(scene.Displacements[at], 0);
                    high += Math.Max(scene.Displacements[at], 0);
                }
            }

            void AddField(Scene scene, int field, float low, float high)
            {
                float weight = scene.Weights[field], coordinate = (low + high) / 2;
                int first = field * scene.IsolineCount, lower = Math.Min((int)coordinate, scene.IsolineCount - 2);
                Middle.Add(new Share((first + lower) * Deformation.TransformSize, weight * (lower + 1 - coordinate)));
                Middle.Add(new Share((first + lower + 1) * Deformation.TransformSize, weight * (coordinate - lower)));
                var gaps = new List<Gap>();
                for (int k = 0; k < scene.IsolineCount - 1; k++)
                {
                    float below = Math.Min(k + 1, coordinate) - Math.Max(k, low), above = Math.Min(k + 1, high) - Math.Max(k, coordinate);
                    if (Math.Max(below, above) > MinSpread)
                    {
                        gaps.Add(new Gap((first + k) * Deformation.TransformSize, weight * Math.Max(below, 0), weight * Math.Max(above, 0)));
                    }
                }
                if (gaps.Count > 0)
                {
                    Fields.Add(gaps);
                }
            }
        }
    }
}
