using System;
using System.Collections.Generic;

namespace Puppetline
{
    /// <summary>
    /// A box around a character that is evaluated elsewhere, at a cost that does not depend on its vertices. Each field
    /// puts a vertex between where the transforms of two isolines put it, and the weights of the fields add up to 1. For
    /// vertices that lie at nearly the same places between the isolines, the transform of the places in the middle says
    /// where they are, but for what the transforms change over the rest of the places. A single transform may be far from
    /// where the character is; their mean is not, and their changes are small over a small piece.
    /// </summary>
    public sealed class ControlBounds
    {
        /// <summary>Pieces that the character is divided into.</summary>
        const int PieceCount = 48;

        /// <summary>A spread of places, in isolines, that is none.</summary>
        const float NoSpread = 1e-6f;

        readonly List<Piece> pieces = new List<Piece>();
        readonly float[] middle = new float[Deformation.TransformSize];
        readonly float[] below = new float[3], above = new float[3], reach = new float[3];

        /// <summary>Prepare for a character.</summary>
        public ControlBounds(Scene scene)
        {
            foreach (List<int> vertices in Divided(scene))
            {
                pieces.Add(new Piece(scene, vertices));
            }
        }

        /// <summary>Return a box that no vertex leaves.</summary>
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

        /// <summary>Add how far a field puts the vertices of a piece at most from where the middle puts them.</summary>
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

        /// <summary>Cut the piece whose places spread most at the middle of them, again and again.</summary>
        static List<List<int>> Divided(Scene scene)
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
                if (!(cuts[most].Spread > NoSpread))
                {
                    break;
                }
                Cut cut = cuts[most];
                List<int> rest = divided[most].FindAll(v => !(scene.Ladder[v * scene.FieldCount + cut.Field] > cut.Place));
                List<int> beyond = divided[most].FindAll(v => scene.Ladder[v * scene.FieldCount + cut.Field] > cut.Place);
                divided[most] = rest;
                cuts[most] = new Cut(scene, rest);
                divided.Add(beyond);
                cuts.Add(new Cut(scene, beyond));
            }
            return divided.FindAll(vertices => vertices.Count > 0);
        }

        /// <summary>Find the least and greatest place of some vertices in a field.</summary>
        static void Range(Scene scene, List<int> vertices, int field, out float low, out float high)
        {
            low = scene.IsolineCount - 1;
            high = 0;
            foreach (int v in vertices)
            {
                float place = Math.Min(Math.Max(scene.Ladder[v * scene.FieldCount + field], 0), scene.IsolineCount - 1);
                low = Math.Min(low, place);
                high = Math.Max(high, place);
            }
        }

        /// <summary>The middle of the places of some vertices in the field in which they spread most.</summary>
        readonly struct Cut
        {
            public readonly int Field;
            public readonly float Place, Spread;

            public Cut(Scene scene, List<int> vertices)
            {
                Field = 0;
                Place = Spread = 0;
                for (int field = 0; field < scene.FieldCount; field++)
                {
                    Range(scene, vertices, field, out float low, out float high);
                    if ((high - low) * scene.Weights[field] > Spread)
                    {
                        Field = field;
                        Place = (low + high) / 2;
                        Spread = (high - low) * scene.Weights[field];
                    }
                }
            }
        }

        /// <summary>A transform, and what it counts in a mean.</summary>
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

        /// <summary>Two isolines, the first of which is named, and how far places spread between them, times the weight of the field.</summary>
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

        /// <summary>Vertices that lie at nearly the same places between the isolines of all fields.</summary>
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
                    box.Add(scene.Positions[3 * v], scene.Positions[3 * v + 1], scene.Positions[3 * v + 2]);
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

            void AddField(Scene scene, int field, float low, float high)
            {
                float weight = scene.Weights[field], place = (low + high) / 2;
                int first = field * scene.IsolineCount, lower = Math.Min((int)place, scene.IsolineCount - 2);
                Middle.Add(new Share((first + lower) * Deformation.TransformSize, weight * (lower + 1 - place)));
                Middle.Add(new Share((first + lower + 1) * Deformation.TransformSize, weight * (place - lower)));
                var gaps = new List<Gap>();
                for (int k = 0; k < scene.IsolineCount - 1; k++)
                {
                    float below = Math.Min(k + 1, place) - Math.Max(k, low), above = Math.Min(k + 1, high) - Math.Max(k, place);
                    if (Math.Max(below, above) > NoSpread)
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
