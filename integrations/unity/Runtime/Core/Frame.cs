using System;
using System.Collections.Generic;

namespace Puppetline
{
    /// <summary>A moment of a character: what stands in a message that comes each frame, its payload as numbers.</summary>
    public sealed class Frame
    {
        /// <summary>What stood in front of it.</summary>
        public Header Header;

        /// <summary>The scene that it belongs to; null for kinds that can be understood without.</summary>
        public Scene Scene;

        /// <summary>When it came, on this machine's <see cref="Clock"/>.</summary>
        public double Arrived;

        /// <summary>
        /// The numbers, of which the first <see cref="Count"/> count: 12 of each transform for controls; the residual and the
        /// weights for morphs; positions and then normals for vertices of either kind; four of each joint; three of each handle.
        /// </summary>
        public float[] Values = new float[0];

        /// <summary>How many numbers there are.</summary>
        public int Count;

        /// <summary>Read a message.</summary>
        /// <returns>False if its payload is not one of its kind.</returns>
        public bool Read(Message message)
        {
            Header = message.Header;
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
                case Kind.Handles:
                    return ReadFloats(payload, 12);
                default:
                    return false;
            }
        }

        /// <summary>Become a mixture of two frames of one scene and kind; what is not a number is taken from the later one.</summary>
        /// <param name="earlier">The one.</param>
        /// <param name="later">The other, as many numbers.</param>
        /// <param name="share">How much there is of the later one, 0 to 1.</param>
        public void Mix(Frame earlier, Frame later, float share)
        {
            Header = later.Header;
            Header.Time = earlier.Header.Time + (later.Header.Time - earlier.Header.Time) * share;
            Header.RootX = Between(earlier.Header.RootX, later.Header.RootX, share);
            Header.RootY = Between(earlier.Header.RootY, later.Header.RootY, share);
            Header.RootZ = Between(earlier.Header.RootZ, later.Header.RootZ, share);
            Scene = later.Scene;
            Arrived = later.Arrived;
            Resize(later.Count);
            float[] values = Values, one = earlier.Values, other = later.Values;
            for (int i = 0; i < Count; i++)
            {
                values[i] = one[i] + (other[i] - one[i]) * share;
            }
        }

        /// <summary>Tell whether all of it can be drawn.</summary>
        public bool IsFinite()
        {
            // anything times zero is zero, but for what is not finite
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
            ReadPlaces(payload.Array, payload.Offset, payload.Offset + Box, 3 * n);
            ReadFolded(payload.Array, payload.Offset + Box + padded, n);
            return true;
        }

        void ReadPlaces(byte[] bytes, int box, int start, int count)
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

        /// <summary>Unfold the octahedral encoding of normals.</summary>
        void ReadFolded(byte[] bytes, int start, int n)
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

    /// <summary>Frames that are not used just now, so that none has to be made each time. Any thread may use it.</summary>
    public sealed class FramePool
    {
        readonly Stack<Frame> free = new Stack<Frame>();

        /// <summary>Take a frame, whatever it holds.</summary>
        public Frame Rent()
        {
            lock (free)
            {
                return free.Count > 0 ? free.Pop() : new Frame();
            }
        }

        /// <summary>Give a frame back that nobody looks at any more.</summary>
        public void Return(Frame frame)
        {
            frame.Scene = null;
            lock (free)
            {
                free.Push(frame);
            }
        }
    }
}
