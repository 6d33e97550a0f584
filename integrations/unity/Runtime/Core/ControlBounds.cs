using System;

namespace Puppetline
{
    /// <summary>
    /// A box around a character that is evaluated elsewhere, at a cost that does not depend on its vertices. Of each field a
    /// vertex lies between two isolines, so that field puts it somewhere between where their transforms put a box around
    /// all such vertices; and the fields' weights add up to 1.
    /// </summary>
    public sealed class ControlBounds
    {
        readonly Scene scene;

        /// <summary>For each transform: the box around the vertices that it acts on, at rest.</summary>
        readonly Box[] reach;

        /// <summary>Prepare for a character.</summary>
        public ControlBounds(Scene scene)
        {
            this.scene = scene;
            reach = new Box[scene.FieldCount * scene.IsolineCount];
            for (int i = 0; i < reach.Length; i++)
            {
                reach[i] = Box.Nothing;
            }
            for (int i = 0; i < scene.Ladder.Length; i++)
            {
                int v = i / scene.FieldCount;
                int k = Math.Min((int)scene.Ladder[i], scene.IsolineCount - 2);
                int transform = i % scene.FieldCount * scene.IsolineCount + k;
                float x = scene.Positions[3 * v], y = scene.Positions[3 * v + 1], z = scene.Positions[3 * v + 2];
                reach[transform].Add(x, y, z);
                reach[transform + 1].Add(x, y, z);
            }
        }

        /// <summary>Return a box that no vertex leaves.</summary>
        public Box Of(float[] controls, Axes axes)
        {
            var sum = default(Box);
            for (int i = 0; i < scene.FieldCount; i++)
            {
                Box field = Box.Nothing;
                for (int k = 0; k < scene.IsolineCount; k++)
                {
                    AddMoved(ref field, reach[i * scene.IsolineCount + k], controls, (i * scene.IsolineCount + k) * Deformation.TransformSize);
                }
                float w = scene.Weights[i];
                sum.LowX += w * field.LowX;
                sum.LowY += w * field.LowY;
                sum.LowZ += w * field.LowZ;
                sum.HighX += w * field.HighX;
                sum.HighY += w * field.HighY;
                sum.HighZ += w * field.HighZ;
            }
            return sum.In(axes);
        }

        static void AddMoved(ref Box to, Box box, float[] T, int t)
        {
            for (int corner = 0; corner < 8 && !box.IsEmpty; corner++)
            {
                float x = (corner & 1) == 0 ? box.LowX : box.HighX;
                float y = (corner & 2) == 0 ? box.LowY : box.HighY;
                float z = (corner & 4) == 0 ? box.LowZ : box.HighZ;
                to.Add(
                    T[t] * x + T[t + 1] * y + T[t + 2] * z + T[t + 3],
                    T[t + 4] * x + T[t + 5] * y + T[t + 6] * z + T[t + 7],
                    T[t + 8] * x + T[t + 9] * y + T[t + 10] * z + T[t + 11]);
            }
        }
    }
}
