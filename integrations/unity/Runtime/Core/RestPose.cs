using System;

namespace Puppetline.Protocol
{
    /// <summary>The rest pose of a character, moved by the mesh's own targets. It is not thread-safe.</summary>
    public sealed class RestPose
    {
        readonly Scene scene;
        float[] weights = new float[0];

        /// <summary>Begin with the rest pose of the scene.</summary>
        public RestPose(Scene scene)
        {
            this.scene = scene;
            Positions = scene.Displacements == null ? scene.Positions : (float[])scene.Positions.Clone();
        }

        /// <summary>n × 3 positions in file coordinates. It stays the same array.</summary>
        public float[] Positions { get; }

        /// <summary>Move the rest pose by the weights of a frame; return whether they differ from the ones before.</summary>
        public bool Move(float[] targets)
        {
            if (scene.Displacements == null || AreShown(targets))
            {
                return false;
            }
            weights = (float[])targets.Clone();
            Array.Copy(scene.Positions, Positions, Positions.Length);
            for (int k = 0; k < Math.Min(weights.Length, scene.Targets.Count); k++)
            {
                for (int i = 0, at = k * Positions.Length; weights[k] != 0 && i < Positions.Length; i++, at++)
                {
                    Positions[i] += weights[k] * scene.Displacements[at];
                }
            }
            return true;
        }

        bool AreShown(float[] targets)
        {
            bool same = targets.Length == weights.Length;
            for (int k = 0; same && k < weights.Length; k++)
            {
                same = targets[k] == weights[k];
            }
            return same;
        }
    }
}
