using System;
using System.Text;

namespace Puppetline
{
    /// <summary>What a message's payload is.</summary>
    public enum Kind : byte
    {
        /// <summary>All of a character that does not change: <see cref="Puppetline.Scene"/>.</summary>
        Scene = 1,

        /// <summary>Affine transforms that act on the rest pose: <see cref="Deformation"/>.</summary>
        Controls = 2,

        /// <summary>Weights of morph targets.</summary>
        Morphs = 3,

        /// <summary>Positions and normals.</summary>
        Vertices = 4,

        /// <summary>Positions and normals in less than half the bytes.</summary>
        Vertices16 = 5,

        /// <summary>The performer's joints.</summary>
        Joints = 6,

        /// <summary>Where handles are to be.</summary>
        Handles = 7,

        /// <summary>Who performs, in JSON.</summary>
        Performer = 8,

        /// <summary>How the service is, in JSON.</summary>
        Status = 9,

        /// <summary>Which characters there are, in JSON.</summary>
        Characters = 10,
    }

    /// <summary>What a performer does to a character.</summary>
    public enum PerformerState : byte
    {
        /// <summary>Nobody performs.</summary>
        Waiting = 0,

        /// <summary>The performer's rest pose is being taken.</summary>
        Calibrating = 1,

        /// <summary>The performer moves the character.</summary>
        Performing = 2,

        /// <summary>The performer has left, and the character eases to rest.</summary>
        Leaving = 3,
    }

    /// <summary>What stands in front of every payload.</summary>
    public struct Header
    {
        /// <summary>The user number of nobody.</summary>
        public const int Nobody = -1;

        /// <summary>What the payload is; a later minor version may have others.</summary>
        public Kind Kind;

        /// <summary>What the performer does.</summary>
        public PerformerState State;

        /// <summary>The source's number of the performer, or <see cref="Nobody"/>.</summary>
        public int User;

        /// <summary>Of the scene that the frame belongs to.</summary>
        public uint Revision;

        /// <summary>One more with each frame of the character.</summary>
        public ulong Sequence;

        /// <summary>Seconds on the source's clock.</summary>
        public double Time;

        /// <summary>Nanoseconds of the service's clock: when what moved the character came in there.</summary>
        public ulong Received;

        /// <summary>Nanoseconds of the service's clock: when the message was made.</summary>
        public ulong Published;

        /// <summary>How far the whole character has walked along x, file coordinates.</summary>
        public float RootX;

        /// <summary>Along y.</summary>
        public float RootY;

        /// <summary>Along z.</summary>
        public float RootZ;
    }

    /// <summary>
    /// A message taken apart, its payload not yet. It points into the bytes that it was made of. Wire and Unity's
    /// platforms are all little-endian, so numbers are read as they lie.
    /// </summary>
    public struct Message
    {
        /// <summary>The protocol's version that this client speaks.</summary>
        public const byte Major = 1;

        const int TopicField = 64;
        const int BeforePayload = 128;

        /// <summary>What stands in front of the payload.</summary>
        public Header Header;

        /// <summary>The topic's ASCII characters.</summary>
        public ArraySegment<byte> TopicBytes;

        /// <summary>What the kind says.</summary>
        public ArraySegment<byte> Payload;

        /// <summary>The topic.</summary>
        public string Topic => Encoding.ASCII.GetString(TopicBytes.Array, TopicBytes.Offset, TopicBytes.Count);

        /// <summary>Tell the protocol's major version of a message; 0 of what is too short to say.</summary>
        public static byte MajorOf(ArraySegment<byte> bytes)
        {
            return bytes.Count < BeforePayload ? (byte)0 : bytes.Array[bytes.Offset + TopicField];
        }

        /// <summary>Take a message apart; false if it is damaged, or of another major version.</summary>
        public static bool TryParse(ArraySegment<byte> bytes, out Message message)
        {
            message = default;
            if (MajorOf(bytes) != Major)
            {
                return false;
            }
            byte[] array = bytes.Array;
            int at = bytes.Offset + TopicField;
            int topic = TopicLength(array, bytes.Offset);
            uint length = BitConverter.ToUInt32(array, at + 12);
            if (topic == 0 || array[at + 3] > (byte)PerformerState.Leaving || length > bytes.Count - BeforePayload)
            {
                return false;
            }
            message.TopicBytes = new ArraySegment<byte>(array, bytes.Offset, topic);
            message.Payload = new ArraySegment<byte>(array, bytes.Offset + BeforePayload, (int)length);
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

        /// <summary>Tell whether the message has exactly this topic.</summary>
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

        /// <summary>Return how many printable characters the field begins with; 0 if it is not padded with zeros.</summary>
        static int TopicLength(byte[] array, int start)
        {
            int length = 0;
            while (length < TopicField && array[start + length] >= 0x20 && array[start + length] < 0x7F)
            {
                length++;
            }
            for (int i = length; i < TopicField; i++)
            {
                if (array[start + i] != 0)
                {
                    return 0;
                }
            }
            return length < TopicField ? length : 0;
        }
    }
}
