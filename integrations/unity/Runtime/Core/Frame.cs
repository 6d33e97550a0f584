using System;
using System.Collections.Generic;
using System.Threading;

namespace Puppetline.Protocol
{
    /// <summary>A frame of a character: the header of its message, and its payload as numbers.</summary>
    public sealed class Frame
    {
        /// <summary>The header of the message.</summary>
        public Header Header;

        /// <summary>The scene of the frame; null for kinds that do not need one.</summary>
        public Scene Scene;

        /// <summary>Time of arrival on this machine's <see cref="Clock"/>.</summary>
        public double Arrived;

        /// <summary>
        /// The numbers, of which only the first <see cref="Count"/> are valid: 12 per transform for controls; the residual and
        /// the weights for morphs; positions and then normals for both kinds of vertices; four per joint; three per handle; for bones a
        /// quaternion per joint of the character, and then three per joint that travels.
        /// </summary>
        public float[] Values = new float[0];

        /// <summary>Number of valid numbers.</summary>
        public int Count;

        /// <summary>Weights of the mesh's own targets, from 0 to 1, in the order of <see cref="Scene.Targets"/>.</summary>
        public float[] Targets = new float[0];

        /// <summary>Number of followers that have not yet returned the frame to the pool.</summary>
        internal int Holders = 1;

        /// <summary>Read a message.</summary>
        /// <returns>False if the payload does not match the kind.</returns>
        public bool Read(Message message)
        {
            Header = message.Header;
            ReadTargets(message.Targets);
            ArraySegment<byte> payload = message.Payload;
            switch (Header.Kind)
            {
                case Kind.Controls:
                    return ReadFloats(payload, 4 * Deformation.TransformSize);
                case Kind.Morphs:
                    return payload.Count > 0 && ReadFloats(payload, 4);
                case Kind.Vertices:
                    return ReadFloats(payload, 24);
                case Kind.Vertices16:
                    return ReadVertices16(payload);
                case Kind.Joints:
                    return payload.Count == 20 * 16 && ReadFloats(payload, 16);
                case Kind.Bones:
                    return ReadFloats(payload, 4);
                case Kind.Handles:
                    return ReadFloats(payload, 12);
                default:
                    return false;
            }
        }

        /// <summary>Interpolate two frames of the same scene and kind. All other values are taken from the later one.</summary>
        /// <param name="earlier">The earlier frame.</param>
        /// <param name="later">The later frame, with the same number of values.</param>
        /// <param name="share">Weight of the later frame, from 0 to 1.</param>
        public void Mix(Frame earlier, Frame later, float share)
        {
            Header = later.Header;
            Header.Time = earlier.Header.Time + (later.Header.Time - earlier.Header.Time) * share;
            Header.RootX = Between(earlier.Header.RootX, later.Header.RootX, share);
            Header.RootY = Between(earlier.Header.RootY, later.Header.RootY, share);
            Header.RootZ = Between(earlier.Header.RootZ, later.Header.RootZ, share);
            Scene = later.Scene;
            Arrived = later.Arrived;
            Array.Resize(ref Targets, Math.Min(earlier.Targets.Length, later.Targets.Length));
            for (int k = 0; k < Targets.Length; k++)
            {
                Targets[k] = Between(earlier.Targets[k], later.Targets[k], share);
            }
            Resize(later.Count);
            float[] values = Values, one = earlier.Values, other = later.Values;
            for (int i = 0; i < Count; i++)
            {
                values[i] = one[i] + (other[i] - one[i]) * share;
            }
            if (Header.Kind == Kind.Bones)
            {
                MixOpposite(one, other, share);
            }
        }

        /// <summary>Mix again quaternions that are on opposite sides, with one negated: it is the same rotation.</summary>
        void MixOpposite(float[] one, float[] other, float share)
        {
            for (int i = 0; i < 4 * Scene.Joints.Count; i += 4)
            {
                if (one[i] * other[i] + one[i + 1] * other[i + 1] + one[i + 2] * other[i + 2] + one[i + 3] * other[i + 3] < 0)
                {
                    for (int k = i; k < i + 4; k++)
                    {
                        Values[k] = one[k] - (other[k] + one[k]) * share;
                    }
                }
            }
        }

        /// <summary>Return whether all numbers are finite.</summary>
        public bool IsFinite()
        {
            // Zero times a finite number is zero; zero times any other is NaN.
            float sum = 0 * (Header.RootX + Header.RootY + Header.RootZ) + 0 * (float)Header.Time;
            float[] values = Values;
            for (int i = 0; i < Count; i++)
            {
                sum += 0 * values[i];
            }
            return sum == 0;
        }

        static float Between(float one, float other, float share)
        {
            return one + (other - one) * share;
        }

        void Resize(int count)
        {
            Count = count;
            if (Values.Length < count)
            {
                Values = new float[count];
            }
        }

        void ReadTargets(ArraySegment<byte> weights)
        {
            Array.Resize(ref Targets, weights.Count / 4);
            for (int k = 0; k < Targets.Length; k++)
            {
                float weight = BitConverter.ToSingle(weights.Array, weights.Offset + 4 * k);
                Targets[k] = weight > 0 ? Math.Min(weight, 1) : 0;
            }
        }

        bool ReadFloats(ArraySegment<byte> payload, int row)
        {
            Resize(payload.Count / 4);
            Buffer.BlockCopy(payload.Array, payload.Offset, Values, 0, 4 * Count);
            return payload.Count % row == 0;
        }

        bool ReadVertices16(ArraySegment<byte> payload)
        {
            const int Box = 24;
            int n = (payload.Count - Box) / 10;
            int padded = (6 * n + 3) / 4 * 4;
            if (n < 0 || payload.Count != Box + padded + 4 * n)
            {
                return false;
            }
            Resize(6 * n);
            ReadQuantised(payload.Array, payload.Offset, payload.Offset + Box, 3 * n);
            ReadOctahedral(payload.Array, payload.Offset + Box + padded, n);
            return true;
        }

        void ReadQuantised(byte[] bytes, int box, int start, int count)
        {
            for (int axis = 0; axis < 3; axis++)
            {
                float low = BitConverter.ToSingle(bytes, box + 4 * axis);
                float step = (BitConverter.ToSingle(bytes, box + 12 + 4 * axis) - low) / 65535;
                for (int i = axis; i < count; i += 3)
                {
                    Values[i] = low + step * BitConverter.ToUInt16(bytes, start + 2 * i);
                }
            }
        }

        /// <summary>Decode normals from the octahedral encoding.</summary>
        void ReadOctahedral(byte[] bytes, int start, int n)
        {
            for (int i = 0; i < n; i++)
            {
                float u = BitConverter.ToInt16(bytes, start + 4 * i) / 32767f;
                float v = BitConverter.ToInt16(bytes, start + 4 * i + 2) / 32767f;
                float z = 1 - Math.Abs(u) - Math.Abs(v);
                float x = z < 0 ? (1 - Math.Abs(v)) * (u >= 0 ? 1 : -1) : u;
                float y = z < 0 ? (1 - Math.Abs(u)) * (v >= 0 ? 1 : -1) : v;
                float scale = 1 / (float)Math.Sqrt(x * x + y * y + z * z);
                int to = 3 * (n + i);
                Values[to] = x * scale;
                Values[to + 1] = y * scale;
                Values[to + 2] = z * scale;
            }
        }
    }

    /// <summary>Pool of unused frames, which avoids allocations. It is thread-safe.</summary>
    public sealed class FramePool
    {
        readonly Stack<Frame> free = new Stack<Frame>();

        /// <summary>Take a frame with arbitrary contents.</summary>
        public Frame Rent()
        {
            lock (free)
            {
                return free.Count > 0 ? free.Pop() : new Frame();
            }
        }

        /// <summary>Return a frame that is not used any more. It is reused when all followers that hold it have returned it.</summary>
        public void Return(Frame frame)
        {
            if (Interlocked.Decrement(ref frame.Holders) > 0)
            {
                return;
            }
            frame.Holders = 1;
            frame.Scene = null;
            lock (free)
            {
                free.Push(frame);
            }
        }
    }
}
