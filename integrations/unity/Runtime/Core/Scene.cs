using System;
using System.Collections.Generic;

namespace Puppetline.Protocol
{
    /// <summary>A part of a character: a primitive of its file, with its own material.</summary>
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

        /// <summary>Name of the part in the file.</summary>
        public string Name { get; }

        /// <summary>Material values of glTF: name, base_color, metallic, roughness, emissive, alpha_mode, double_sided.</summary>
        public Json Material { get; }

        /// <summary>Index of the first vertex.</summary>
        public int FirstVertex { get; }

        /// <summary>Number of vertices.</summary>
        public int VertexCount { get; }

        /// <summary>Index of the first triangle.</summary>
        public int FirstTriangle { get; }

        /// <summary>Number of triangles.</summary>
        public int TriangleCount { get; }
    }

    /// <summary>
    /// The constant data of a character as sent by the service, in file coordinates, which are right-handed, with
    /// counter-clockwise triangles. Arrays are flat, row after row.
    /// </summary>
    public sealed class Scene
    {
        const int MaxFields = 64, MaxIsolines = 640;

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
            int maximum = arrays.Count / 4;
            VertexCount = Count(Description["vertices"], 1, maximum, "vertices");
            TriangleCount = Count(Description["triangles"], 1, maximum, "triangles");
            FieldCount = Count(Description["fields"], 1, MaxFields, "fields");
            IsolineCount = Count(Description["isolines"], 2, MaxIsolines, "isolines");
            Weights = Numbers(Description["weights"]);
            Triangles = new int[3 * TriangleCount];
            Fill(Triangles, "triangles", "u32", TriangleCount, 3);
            Positions = Floats("positions", VertexCount, 3);
            Normals = Floats("normals", VertexCount, 3);
            IsolineCoordinates = Floats("ladder", VertexCount, FieldCount);
            Slopes = Floats("slopes", VertexCount, FieldCount, 2);
            Uv = Optional("uv", VertexCount, 2);
            Colors = Optional("colors", VertexCount, 3);
            Targets = Strings(Description["targets"]);
            Displacements = Optional("displacements", Targets.Count, VertexCount, 3);
            Parts = ReadParts();
            Morphs = Strings(Description["morphs"]);
            Joints = ReadJoints();
            arrays = default;
            Check();
        }

        /// <summary>The whole description, including values without a property in this class.</summary>
        public Json Description { get; }

        /// <summary>Revision of the scene, which its frames refer to.</summary>
        public uint Revision { get; private set; }

        /// <summary>Number of vertices, n.</summary>
        public int VertexCount { get; }

        /// <summary>Number of triangles, t.</summary>
        public int TriangleCount { get; }

        /// <summary>Number of fields of the reduced model.</summary>
        public int FieldCount { get; }

        /// <summary>Number of isolines per field.</summary>
        public int IsolineCount { get; }

        /// <summary>Weight of each field.</summary>
        public float[] Weights { get; }

        /// <summary>t × 3 vertex indices.</summary>
        public int[] Triangles { get; }

        /// <summary>n × 3 positions of the rest pose.</summary>
        public float[] Positions { get; }

        /// <summary>n × 3 unit normals of the rest pose; zero where the normal is undefined.</summary>
        public float[] Normals { get; }

        /// <summary>n × fields isoline coordinates.</summary>
        public float[] IsolineCoordinates { get; }

        /// <summary>n × fields × 2 slopes: derivatives of the isoline coordinates along two tangents.</summary>
        public float[] Slopes { get; }

        /// <summary>n × 2 texture coordinates of glTF, from the upper left; null if there are none.</summary>
        public float[] Uv { get; }

        /// <summary>n × 3 linear RGB: vertex colour × material × texture; null if there are none.</summary>
        public float[] Colors { get; }

        /// <summary>The parts, in the order of the file.</summary>
        public IReadOnlyList<Part> Parts { get; }

        /// <summary>Names of the morph targets; empty if there are none.</summary>
        public IReadOnlyList<string> Morphs { get; }

        /// <summary>Names of the mesh's own targets whose weights frames have; empty if there are none.</summary>
        public IReadOnlyList<string> Targets { get; }

        /// <summary>targets × n × 3 displacements of the rest pose by the mesh's own targets; null if there are none.</summary>
        public float[] Displacements { get; }

        /// <summary>The character's joints, parents first; empty if its puppet file has no limbs.</summary>
        public IReadOnlyList<Joint> Joints { get; }

        /// <summary>Length of the diagonal of the bounding box at rest.</summary>
        public float Diagonal => (float)Description["diagonal"].Number;

        /// <summary>Number of values in a payload of controls.</summary>
        public int ControlCount => FieldCount * IsolineCount * Deformation.TransformSize;

        /// <summary>Number of values in a payload of bones.</summary>
        public int BoneValueCount
        {
            get
            {
                int count = 4 * Joints.Count;
                foreach (Joint joint in Joints)
                {
                    count += joint.Travels ? 3 : 0;
                }
                return count;
            }
        }

        /// <summary>Read the message of a scene.</summary>
        /// <exception cref="FormatException">The message is damaged: a length, an offset or a number is invalid.</exception>
        public static Scene Parse(Message message)
        {
            return new Scene(message.Payload) { Revision = message.Header.Revision };
        }

        internal static int Count(Json value, int minimum, int maximum, string what)
        {
            double number = value.Number;
            if (value.Kind != JsonKind.Number || number < minimum || number > maximum || number != Math.Floor(number))
            {
                throw new FormatException("a scene with a missing or invalid number of " + what + " (" + number + ")");
            }
            return (int)number;
        }

        float[] Floats(string name, params int[] shape)
        {
            int count = 1;
            foreach (int length in shape)
            {
                // The size is limited before memory is allocated.
                count = (int)Math.Min((long)count * length, int.MaxValue / 4);
            }
            var values = new float[Math.Min(count, arrays.Count / 4)];
            Fill(values, name, "f32", shape);
            foreach (float value in values)
            {
                if (float.IsNaN(value) || float.IsInfinity(value))
                {
                    throw new FormatException("a scene whose " + name + " are not all finite");
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
                throw new FormatException("a scene whose " + name + " are missing or have the wrong size");
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
                    throw new FormatException("a triangle with a vertex that does not exist");
                }
            }
            foreach (float coordinate in IsolineCoordinates)
            {
                if (!(coordinate >= 0 && coordinate <= IsolineCount - 1))
                {
                    throw new FormatException("an isoline coordinate beyond the isolines");
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

        Joint[] ReadJoints()
        {
            Json entries = Description["bones"];
            var joints = new Joint[entries.Count];
            for (int i = 0; i < joints.Length; i++)
            {
                joints[i] = new Joint(entries[i], i);
            }
            return joints;
        }

        internal static float[] Numbers(Json list)
        {
            var numbers = new float[list.Count];
            for (int i = 0; i < numbers.Length; i++)
            {
                numbers[i] = (float)list[i].Number;
            }
            return numbers;
        }

        static string[] Strings(Json list)
        {
            var strings = new string[list.Count];
            for (int i = 0; i < strings.Length; i++)
            {
                strings[i] = list[i].Text;
            }
            return strings;
        }
    }
}
