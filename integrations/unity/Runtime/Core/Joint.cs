using System;

namespace Puppetline.Protocol
{
    /// <summary>A joint of a character, in file coordinates (docs/protocol.md, Bones).</summary>
    public sealed class Joint
    {
        internal Joint(Json entry, int number)
        {
            Name = entry["name"].Text;
            Parent = Scene.Count(entry["parent"], -1, number - 1, "the parent of a joint");
            Position = Finite(entry["position"], 3);
            Rotation = Finite(entry["rotation"], 4);
            Travels = entry["travels"].True;
            FromTPose = entry["from_t_pose"].Kind == JsonKind.Null ? null : Finite(entry["from_t_pose"], 4);
        }

        /// <summary>VRM's name for joints of humanoids, another one for others.</summary>
        public string Name { get; }

        /// <summary>Number of the parent; −1 for none.</summary>
        public int Parent { get; }

        /// <summary>Position at rest relative to the parent.</summary>
        public float[] Position { get; }

        /// <summary>Rotation at rest relative to the parent: unit quaternion x, y, z, w.</summary>
        public float[] Rotation { get; }

        /// <summary>Whether frames have the joint's position.</summary>
        public bool Travels { get; }

        /// <summary>Rotation from the T-pose to rest; null for joints that a humanoid does not have.</summary>
        public float[] FromTPose { get; }

        static float[] Finite(Json list, int count)
        {
            float[] numbers = Scene.Numbers(list);
            if (numbers.Length != count || Array.Exists(numbers, each => float.IsNaN(each) || float.IsInfinity(each)))
            {
                throw new FormatException("a joint with invalid numbers");
            }
            return numbers;
        }
    }
}
