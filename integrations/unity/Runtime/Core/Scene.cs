using System;
using System.Collections.Generic;

namespace Puppetline
{
    /// <summary>A part of a character: a primitive of its file, with a material of its own.</summary>
    public sealed class Part
    {
        internal Part(Json entry, int vertices, int triangles)
        {
            Name = entry["name"].Text;
            Material = entry["material"];
            FirstVertex = Scene.Count(entry["vertices"][0], 0, vertices, "a part");
            VertexCount = Scene.Count(entry["vertices"][1], 0, vertices - FirstVertex, "a part");
            FirstTriangle = Scene.Count(entry["triangles"][0], 0, triangles, "a part");
            TriangleCount = Scene.Count(entry["triangles"][1], 0, triangles - FirstTriangle, "a part");
        }

        /// <summary>What the file calls it.</summary>
        public string Name { get; }

        /// <summary>glTF's plain values: name, base_color, metallic, roughness, emissive, alpha_mode, double_sided.</summary>
        public Json Material { get; }

        /// <summary>Its first vertex.</summary>
        public int FirstVertex { get; }

        /// <summary>How many vertices it has.</summary>
        public int VertexCount { get; }

        /// <summary>Its first triangle.</summary>
        public int FirstTriangle { get; }

        /// <summary>How many triangles it has.</summary>
        public int TriangleCount { get; }
    }

    /// <summary>
    /// All of a character that does not change, as the service has sent it: file coordinates, which are right-handed,
    /// with counter-clockwise triangles. Arrays are flat, row after row.
    /// </summary>
    public sealed class Scene
    {
        const int MostFields = 64, MostIsolines = 640;

        readonly ArraySegment<byte> arrays;

        Scene(ArraySegment<byte> payload)
        {
            if (payload.Count < 4)
            {
                throw new FormatException("a scene without a description");
            }
            uint length = BitConverter.ToUInt32(payload.Array, payload.Offset);
            if (length > payload.Count - 4)
            {
                throw new FormatException("a description of " + length + " bytes in a scene of " + payload.Count);
            }
            Description = Json.Parse(new ArraySegment<byte>(payload.Array, payload.Offset + 4, (int)length));
            int start = 4 + (int)length;
            arrays = new ArraySegment<byte>(payload.Array, payload.Offset + start, payload.Count - start);
            int most = arrays.Count / 4;
            VertexCount = Count(Description["vertices"], 1, most, "vertices");
            TriangleCount = Count(Description["triangles"], 1, most, "triangles");
            FieldCount = Count(Description["fields"], 1, MostFields, "fields");
            IsolineCount = Count(Description["isolines"], 2, MostIsolines, "isolines");
            Weights = Numbers(Description["weights"]);
            Triangles = new int[3 * TriangleCount];
            Fill(Triangles, "triangles", "u32", TriangleCount, 3);
            Positions = Floats("positions", VertexCount, 3);
            Normals = Floats("normals", VertexCount, 3);
            Ladder = Floats("ladder", VertexCount, FieldCount);
            Slopes = Floats("slopes", VertexCount, FieldCount, 2);
            Uv = Optional("uv", VertexCount, 2);
            Colors = Optional("colors", VertexCount, 3);
            Parts = ReadParts();
            Morphs = Texts(Description["morphs"]);
            arrays = default;
            Check();
        }

        /// <summary>The description, with all that has no property here.</summary>
        public Json Description { get; }

        /// <summary>What frames that belong to it name.</summary>
        public uint Revision { get; private set; }

        /// <summary>n.</summary>
        public int VertexCount { get; }

        /// <summary>t.</summary>
        public int TriangleCount { get; }

        /// <summary>Fields of the reduced model.</summary>
        public int FieldCount { get; }

        /// <summary>Isolines of each field.</summary>
        public int IsolineCount { get; }

        /// <summary>Each field's weight.</summary>
        public float[] Weights { get; }

        /// <summary>t × 3 vertices.</summary>
        public int[] Triangles { get; }

        /// <summary>n × 3, the rest pose.</summary>
        public float[] Positions { get; }

        /// <summary>n × 3 unit normals of the rest pose; zero for a vertex without a direction.</summary>
        public float[] Normals { get; }

        /// <summary>n × fields ladder coordinates.</summary>
        public float[] Ladder { get; }

        /// <summary>n × fields × 2: how fast ladder coordinates change along two tangents.</summary>
        public float[] Slopes { get; }

        /// <summary>n × 2 texture coordinates as glTF has them, from the upper left; null if there are none.</summary>
        public float[] Uv { get; }

        /// <summary>n × 3 linear RGB: vertex colour × material × texture; null if there are none.</summary>
        public float[] Colors { get; }

        /// <summary>The parts, in order.</summary>
        public IReadOnlyList<Part> Parts { get; }

        /// <summary>Names of the morph targets; empty if there are none.</summary>
        public IReadOnlyList<string> Morphs { get; }

        /// <summary>The diagonal of the bounding box at rest.</summary>
        public float Diagonal => (float)Description["diagonal"].Number;

        /// <summary>Numbers that a payload of controls has.</summary>
        public int ControlCount => FieldCount * IsolineCount * Deformation.TransformSize;

        /// <summary>Read the message of a scene.</summary>
        /// <exception cref="FormatException">A length, place or number that the message does not bear out.</exception>
        public static Scene Parse(Message message)
        {
            return new Scene(message.Payload) { Revision = message.Header.Revision };
        }

        internal static int Count(Json value, int least, int most, string what)
        {
            double number = value.Number;
            if (value.Kind != JsonKind.Number || number < least || number > most || number != Math.Floor(number))
            {
                throw new FormatException("a scene that does not say how many " + what + " it has, or says " + number);
            }
            return (int)number;
        }

        float[] Floats(string name, params int[] shape)
        {
            int count = 1;
            foreach (int length in shape)
            {
                // what cannot be there is found out before it takes memory
                count = (int)Math.Min((long)count * length, int.MaxValue / 4);
            }
            var values = new float[Math.Min(count, arrays.Count / 4)];
            Fill(values, name, "f32", shape);
            foreach (float value in values)
            {
                if (float.IsNaN(value) || float.IsInfinity(value))
                {
                    throw new FormatException("a scene whose " + name + " are not all numbers");
                }
            }
            return values;
        }

        float[] Optional(string name, params int[] shape)
        {
            return Description["arrays"][name].Kind == JsonKind.Null ? null : Floats(name, shape);
        }

        void Fill(Array values, string name, string type, params int[] shape)
        {
            Json entry = Description["arrays"][name];
            bool fits = entry["type"].Text == type && entry["shape"].Count == shape.Length;
            long bytes = 4;
            for (int i = 0; i < shape.Length; i++)
            {
                fits = fits && entry["shape"][i].Number == shape[i];
                bytes *= shape[i];
            }
            double offset = entry["offset"].Kind == JsonKind.Number ? entry["offset"].Number : -1;
            if (!fits || offset < 0 || offset % 4 != 0 || offset + bytes > arrays.Count)
            {
                throw new FormatException("a scene whose " + name + " are not there or do not fit the rest");
            }
            Buffer.BlockCopy(arrays.Array, arrays.Offset + (int)offset, values, 0, (int)bytes);
        }

        void Check()
        {
            if (Weights.Length != FieldCount)
            {
                throw new FormatException("a scene whose " + FieldCount + " fields have " + Weights.Length + " weights");
            }
            foreach (int vertex in Triangles)
            {
                if ((uint)vertex >= (uint)VertexCount)
                {
                    throw new FormatException("a triangle of a vertex that is not there");
                }
            }
            foreach (float coordinate in Ladder)
            {
                if (!(coordinate >= 0 && coordinate <= IsolineCount - 1))
                {
                    throw new FormatException("a ladder coordinate beyond the isolines");
                }
            }
        }

        Part[] ReadParts()
        {
            Json entries = Description["parts"];
            var parts = new Part[entries.Count];
            for (int i = 0; i < parts.Length; i++)
            {
                parts[i] = new Part(entries[i], VertexCount, TriangleCount);
            }
            return parts;
        }

        static float[] Numbers(Json list)
        {
            var numbers = new float[list.Count];
            for (int i = 0; i < numbers.Length; i++)
            {
                numbers[i] = (float)list[i].Number;
            }
            return numbers;
        }

        static string[] Texts(Json list)
        {
            var texts = new string[list.Count];
            for (int i = 0; i < texts.Length; i++)
            {
                texts[i] = list[i].Text;
            }
            return texts;
        }
    }
}
