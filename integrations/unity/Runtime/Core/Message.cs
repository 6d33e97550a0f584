using System;
using System.Text;

namespace Puppetline.Protocol
{
    /// <summary>Type of a message's payload.</summary>
    public enum Kind : byte
    {
        /// <summary>The constant data of a character: <see cref="Puppetline.Protocol.Scene"/>.</summary>
        Scene = 1,

        /// <summary>Affine transforms that act on the rest pose: <see cref="Deformation"/>.</summary>
        Controls = 2,

        /// <summary>Weights of morph targets.</summary>
        Morphs = 3,

        /// <summary>Positions and normals.</summary>
        Vertices = 4,

        /// <summary>Quantised positions and normals, in less than half the bytes.</summary>
        Vertices16 = 5,

        /// <summary>The performer's joints.</summary>
        Joints = 6,

        /// <summary>Target positions of the handles.</summary>
        Handles = 7,

        /// <summary>The performer, in JSON.</summary>
        Performer = 8,

        /// <summary>Status of the service, in JSON.</summary>
        Status = 9,

        /// <summary>List of characters, in JSON.</summary>
        Characters = 10,

        /// <summary>Description of a clip file, in JSON (docs/clips.md).</summary>
        Clip = 11,

        /// <summary>Rotations of the character's joints, and positions of those that travel: <see cref="Joint"/>.</summary>
        Bones = 12,

        /// <summary>The performer's channels, in JSON.</summary>
        Channels = 13,
    }

    /// <summary>State of a character's performer.</summary>
    public enum PerformerState : byte
    {
        /// <summary>There is no performer.</summary>
        Waiting = 0,

        /// <summary>The performer's rest pose is being taken.</summary>
        Calibrating = 1,

        /// <summary>The performer drives the character.</summary>
        Performing = 2,

        /// <summary>The performer has left, and the character eases into its rest pose.</summary>
        Leaving = 3,
    }

    /// <summary>Header of a message.</summary>
    public struct Header
    {
        /// <summary>User number of a message without a performer.</summary>
        public const int Nobody = -1;

        /// <summary>Type of the payload; later minor versions can add types.</summary>
        public Kind Kind;

        /// <summary>State of the performer.</summary>
        public PerformerState State;

        /// <summary>The source's user number of the performer, or <see cref="Nobody"/>.</summary>
        public int User;

        /// <summary>Revision of the scene that the frame belongs to.</summary>
        public uint Revision;

        /// <summary>Number of the frame; it increases by one with each frame of the character.</summary>
        public ulong Sequence;

        /// <summary>Time of the frame on the source's clock, in seconds.</summary>
        public double Time;

        /// <summary>Time at which the service received the data of the frame, in nanoseconds of the service's clock.</summary>
        public ulong Received;

        /// <summary>Time at which the service made the message, in nanoseconds of the service's clock.</summary>
        public ulong Published;

        /// <summary>Displacement of the character by root motion along x, in file coordinates.</summary>
        public float RootX;

        /// <summary>Displacement of the character by root motion along y, in file coordinates.</summary>
        public float RootY;

        /// <summary>Displacement of the character by root motion along z, in file coordinates.</summary>
        public float RootZ;
    }

    /// <summary>
    /// A message with its header decoded and its payload not yet decoded. It refers to the received bytes. The protocol
    /// and all of Unity's platforms are little-endian, so numbers are read without conversion.
    /// </summary>
    public struct Message
    {
        /// <summary>Major version of the protocol that this client supports.</summary>
        public const byte Major = 1;

        const int TopicFieldLength = 64;
        const int HeaderLength = 128;

        /// <summary>The header of the message.</summary>
        public Header Header;

        /// <summary>The topic's ASCII characters.</summary>
        public ArraySegment<byte> TopicBytes;

        /// <summary>The payload, whose format depends on the kind.</summary>
        public ArraySegment<byte> Payload;

        /// <summary>Weights of the mesh's own targets, 4 bytes each; empty if nothing moves them.</summary>
        public ArraySegment<byte> Targets;

        /// <summary>The topic.</summary>
        public string Topic => Encoding.ASCII.GetString(TopicBytes.Array, TopicBytes.Offset, TopicBytes.Count);

        /// <summary>Return the major version of the protocol of a message; 0 if the message is too short.</summary>
        public static byte MajorOf(ArraySegment<byte> bytes)
        {
            return bytes.Count < HeaderLength ? (byte)0 : bytes.Array[bytes.Offset + TopicFieldLength];
        }

        /// <summary>Parse a message; return false if it is damaged or has another major version.</summary>
        public static bool TryParse(ArraySegment<byte> bytes, out Message message)
        {
            message = default;
            if (MajorOf(bytes) != Major)
            {
                return false;
            }
            byte[] array = bytes.Array;
            int at = bytes.Offset + TopicFieldLength;
            int topic = TopicLength(array, bytes.Offset);
            uint length = BitConverter.ToUInt32(array, at + 12);
            long targets = 4L * BitConverter.ToUInt32(array, at + 60);
            if (topic == 0 || array[at + 3] > (byte)PerformerState.Leaving || length + targets > bytes.Count - HeaderLength)
            {
                return false;
            }
            message.TopicBytes = new ArraySegment<byte>(array, bytes.Offset, topic);
            message.Payload = new ArraySegment<byte>(array, bytes.Offset + HeaderLength, (int)length);
            message.Targets = new ArraySegment<byte>(array, bytes.Offset + HeaderLength + (int)length, (int)targets);
            message.Header = new Header
            {
                Kind = (Kind)array[at + 2],
                State = (PerformerState)array[at + 3],
                User = BitConverter.ToInt32(array, at + 4),
                Revision = BitConverter.ToUInt32(array, at + 8),
                Sequence = BitConverter.ToUInt64(array, at + 16),
                Time = BitConverter.ToDouble(array, at + 24),
                Received = BitConverter.ToUInt64(array, at + 32),
                Published = BitConverter.ToUInt64(array, at + 40),
                RootX = BitConverter.ToSingle(array, at + 48),
                RootY = BitConverter.ToSingle(array, at + 52),
                RootZ = BitConverter.ToSingle(array, at + 56),
            };
            return true;
        }

        /// <summary>Return whether the message has exactly this topic.</summary>
        public bool Has(byte[] topic)
        {
            if (topic == null || topic.Length != TopicBytes.Count)
            {
                return false;
            }
            for (int i = 0; i < topic.Length; i++)
            {
                if (topic[i] != TopicBytes.Array[TopicBytes.Offset + i])
                {
                    return false;
                }
            }
            return true;
        }

        /// <summary>Return the number of printable characters before the zero padding; 0 if the padding is invalid.</summary>
        static int TopicLength(byte[] array, int start)
        {
            int length = 0;
            while (length < TopicFieldLength && array[start + length] >= 0x20 && array[start + length] < 0x7F)
            {
                length++;
            }
            for (int i = length; i < TopicFieldLength; i++)
            {
                if (array[start + i] != 0)
                {
                    return 0;
                }
            }
            return length < TopicFieldLength ? length : 0;
        }
    }
}
