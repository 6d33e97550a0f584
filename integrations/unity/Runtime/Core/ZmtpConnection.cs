using System;
using System.Net.Sockets;
using System.Text;

namespace Puppetline.Protocol
{
    /// <summary>
    /// A ZMTP 3 connection over TCP, limited to what the service uses: one peer, messages of one part, mechanism NULL or
    /// PLAIN. Opening and sending wait for the network, so use it on a separate thread.
    /// </summary>
    public sealed class ZmtpConnection : IDisposable
    {
        const int HandshakeTimeoutMilliseconds = 5000;
        const int GreetingLength = 64, SignatureLength = 10;
        const int MaxCommandBytes = 65536;
        const byte More = 1, Long = 2, Command = 4;

        readonly Socket socket;
        readonly string where;
        byte[] buffer = new byte[16384];
        int start, end;

        /// <summary>Size of the frame that begins at start, including its header, in bytes; 0 while it is unknown.</summary>
        int expected;

        int largest = MaxCommandBytes;

        ZmtpConnection(Socket socket, string where)
        {
            this.socket = socket;
            this.where = where;
        }

        /// <summary>Time of <see cref="Clock"/> at which bytes were last received, also of an incomplete message.</summary>
        public double Heard { get; private set; }

        /// <summary>Connect and perform the handshake.</summary>
        /// <param name="host">A host name or an address.</param>
        /// <param name="port">A TCP port.</param>
        /// <param name="socketType">SUB or DEALER.</param>
        /// <param name="token">The password of PLAIN; null or empty for NULL.</param>
        /// <param name="largestMessage">Maximum size of a message in bytes; a larger one ends the connection before memory is allocated.</param>
        /// <exception cref="RefusedException">The token is wrong or missing, or the service has no token.</exception>
        /// <exception cref="ZmtpException">The connection failed for another reason.</exception>
        public static ZmtpConnection Open(string host, int port, string socketType, string token, int largestMessage)
        {
            string where = host + ":" + port;
            var connection = new ZmtpConnection(TcpSocket.Connect(host, port, HandshakeTimeoutMilliseconds), where);
            try
            {
                connection.PerformHandshake(socketType, token ?? "");
                connection.largest = largestMessage;
                return connection;
            }
            catch
            {
                connection.Dispose();
                throw;
            }
        }

        /// <summary>Wait for the next message. It is valid until the next call, because it refers to an internal buffer.</summary>
        /// <param name="milliseconds">Maximum time to wait.</param>
        /// <param name="message">The body of the message.</param>
        /// <returns>False if no complete message has arrived in that time.</returns>
        /// <exception cref="ZmtpException">The connection is lost, or the received data is not valid ZMTP.</exception>
        public bool Receive(int milliseconds, out ArraySegment<byte> message)
        {
            int until = Environment.TickCount + milliseconds;
            do
            {
                if (!ReadFrame(until, out byte flags, out message))
                {
                    return false;
                }
                if ((flags & More) != 0)
                {
                    throw new ZmtpException(where + " sent a message of several parts; expected messages of one part");
                }
                if ((flags & Command) == 0)
                {
                    return true;
                }
                Answer(message);
            }
            while (until - Environment.TickCount > 0);
            return false;
        }

        /// <summary>Send a message of one part.</summary>
        /// <exception cref="ZmtpException">The connection is lost.</exception>
        public void Send(byte[] body)
        {
            SendFrame(0, body);
        }

        /// <summary>Subscribe to exactly this topic.</summary>
        /// <exception cref="ZmtpException">The connection is lost.</exception>
        public void Subscribe(string topic)
        {
            Send(Encoding.ASCII.GetBytes("\u0001" + topic + "\0"));
        }

        /// <summary>Cancel the subscription to this topic.</summary>
        /// <exception cref="ZmtpException">The connection is lost.</exception>
        public void Unsubscribe(string topic)
        {
            Send(Encoding.ASCII.GetBytes("\0" + topic + "\0"));
        }

        /// <summary>Close the connection.</summary>
        public void Dispose()
        {
            socket.Close();
        }

        void PerformHandshake(string socketType, string token)
        {
            int until = Environment.TickCount + HandshakeTimeoutMilliseconds;
            string mechanism = token.Length == 0 ? "NULL" : "PLAIN";
            SendAll(OwnGreeting(mechanism));
            CheckGreeting(until, mechanism);
            byte[] property = Join(Short("Socket-Type"), new byte[] { 0, 0, 0 }, Short(socketType));
            if (mechanism == "PLAIN")
            {
                SendFrame(Command, Join(Short("HELLO"), Short("puppetline"), Short(token)));
                Await(until, "WELCOME");
                SendFrame(Command, Join(Short("INITIATE"), property));
            }
            else
            {
                SendFrame(Command, Join(Short("READY"), property));
            }
            Await(until, "READY");
        }

        static byte[] OwnGreeting(string mechanism)
        {
            var greeting = new byte[GreetingLength];
            greeting[0] = 0xFF;
            greeting[9] = 0x7F;
            greeting[10] = 3;
            Encoding.ASCII.GetBytes(mechanism, 0, mechanism.Length, greeting, 12);
            return greeting;
        }

        void CheckGreeting(int until, string mechanism)
        {
            try
            {
                while (end - start < GreetingLength)
                {
                    if (!Fill(until))
                    {
                        throw new ZmtpException(where + " did not send a ZMTP greeting. Check the port.");
                    }
                }
            }
            catch (ZmtpException) when (end - start >= SignatureLength && buffer[0] == 0xFF)
            {
                // libzmq does this if the mechanisms differ, but the service may also have ended.
                string token = mechanism == "NULL" ? "It may require a token." : "It may have no token.";
                throw new ZmtpException(where + " has closed the connection during the handshake. " + token);
            }
            if (buffer[0] != 0xFF || buffer[9] != 0x7F || buffer[10] < 3)
            {
                throw new ZmtpException(where + " does not support ZMTP 3. Check the port.");
            }
            string theirs = Encoding.ASCII.GetString(buffer, 12, 20).TrimEnd('\0');
            if (theirs != mechanism)
            {
                throw new RefusedException(where + Mismatch(theirs));
            }
            start += GreetingLength;
        }

        static string Mismatch(string theirs)
        {
            switch (theirs)
            {
                case "PLAIN":
                    return " requires a token. Set it.";
                case "NULL":
                    return " has no token. Leave the token empty.";
                default:
                    return " requires the mechanism " + theirs + ", which this client does not support. Configure a token on the service.";
            }
        }

        void Await(int until, string name)
        {
            if (!ReadFrame(until, out byte flags, out ArraySegment<byte> body))
            {
                throw new ZmtpException(where + " did not complete the handshake");
            }
            if (IsError(flags, body))
            {
                throw new RefusedException(where + " does not accept the token. Set the token of the service.");
            }
            if ((flags & Command) == 0 || !Begins(body, name))
            {
                throw new ZmtpException(where + " did not follow the ZMTP handshake. Check the port.");
            }
        }

        /// <summary>Return whether a frame is an ERROR command. Its first byte is wrong in libzmq 4.3.5.</summary>
        static bool IsError(byte flags, ArraySegment<byte> body)
        {
            return (flags & Command) != 0 && (Begins(body, "ERROR") || Begins(body, "RROR", 0x5E));
        }

        void Answer(ArraySegment<byte> command)
        {
            const int PingHeaderLength = 7, MaxContextLength = 16;
            if (IsError(Command, command))
            {
                throw new RefusedException(where + " has ended the connection");
            }
            if (Begins(command, "PING") && command.Count >= PingHeaderLength && command.Count <= PingHeaderLength + MaxContextLength)
            {
                var context = new byte[command.Count - PingHeaderLength];
                Buffer.BlockCopy(command.Array, command.Offset + PingHeaderLength, context, 0, context.Length);
                SendFrame(Command, Join(Short("PONG"), context));
            }
        }

        static bool Begins(ArraySegment<byte> body, string name)
        {
            return Begins(body, name, (byte)name.Length);
        }

        static bool Begins(ArraySegment<byte> body, string name, byte first)
        {
            return body.Count > name.Length && body.Array[body.Offset] == first
                && Encoding.ASCII.GetString(body.Array, body.Offset + 1, name.Length) == name;
        }

        /// <summary>Wait for a complete frame. The bytes of an incomplete frame stay in the buffer for the next call.</summary>
        bool ReadFrame(int until, out byte flags, out ArraySegment<byte> body)
        {
            while (!TryParseFrame(out flags, out body))
            {
                if (!Fill(until))
                {
                    return false;
                }
            }
            return true;
        }

        bool TryParseFrame(out byte flags, out ArraySegment<byte> body)
        {
            flags = end > start ? buffer[start] : (byte)0;
            body = default;
            int head = (flags & Long) != 0 ? 9 : 2;
            if ((flags & ~(More | Long | Command)) != 0)
            {
                throw new ZmtpException(where + " sent data that is not ZMTP");
            }
            if (end - start < head)
            {
                return false;
            }
            ulong size = Size(head);
            if (size > (ulong)largest)
            {
                throw new ZmtpException(where + " sent a message of " + size + " bytes; expected at most " + largest);
            }
            expected = head + (int)size;
            if (end - start < expected)
            {
                return false;
            }
            body = new ArraySegment<byte>(buffer, start + head, (int)size);
            start += expected;
            expected = 0;
            return true;
        }

        ulong Size(int head)
        {
            ulong size = 0;
            for (int i = start + 1; i < start + head; i++)
            {
                size = size << 8 | buffer[i];
            }
            return size;
        }

        /// <summary>Wait for more bytes; return false if none arrived in time.</summary>
        bool Fill(int until)
        {
            int left = Math.Max(0, until - Environment.TickCount);
            try
            {
                if (!socket.Poll(left * 1000, SelectMode.SelectRead))
                {
                    return false;
                }
                MakeRoom();
                int count = socket.Receive(buffer, end, buffer.Length - end, SocketFlags.None);
                if (count == 0)
                {
                    throw new ZmtpException(where + " has closed the connection");
                }
                end += count;
                Heard = Clock.Now;
                return true;
            }
            catch (SocketException error)
            {
                throw new ZmtpException(where + ": " + error.Message);
            }
        }

        /// <summary>
        /// Make room for at least one byte. The buffer grows to at most twice the received bytes, whatever size was announced.
        /// </summary>
        void MakeRoom()
        {
            if (start == end)
            {
                start = end = 0;
            }
            if (end < buffer.Length)
            {
                return;
            }
            byte[] roomy = start > 0 ? buffer : new byte[Math.Max(Math.Min(2L * buffer.Length, expected), buffer.Length + 9L)];
            Buffer.BlockCopy(buffer, start, roomy, 0, end - start);
            end -= start;
            start = 0;
            buffer = roomy;
        }

        void SendFrame(byte flags, byte[] body)
        {
            SendAll(body.Length < 256
                ? Join(new[] { flags, (byte)body.Length }, body)
                : Join(new byte[] { (byte)(flags | Long), 0, 0, 0, 0 }, BigEndian(body.Length), body));
        }

        void SendAll(byte[] bytes)
        {
            try
            {
                for (int sent = 0; sent < bytes.Length;)
                {
                    sent += socket.Send(bytes, sent, bytes.Length - sent, SocketFlags.None);
                }
            }
            catch (SocketException error)
            {
                throw new ZmtpException(where + ": " + error.Message);
            }
        }

        static byte[] BigEndian(int number)
        {
            return new[] { (byte)(number >> 24), (byte)(number >> 16), (byte)(number >> 8), (byte)number };
        }

        /// <summary>Return the bytes of a string with their length in front of them.</summary>
        static byte[] Short(string text)
        {
            byte[] bytes = Encoding.UTF8.GetBytes(text);
            return bytes.Length < 256 ? Join(new[] { (byte)bytes.Length }, bytes) : throw new RefusedException("The token has more than 255 bytes. Correct the token.");
        }

        static byte[] Join(params byte[][] parts)
        {
            int length = 0;
            foreach (byte[] part in parts)
            {
                length += part.Length;
            }
            var joined = new byte[length];
            int at = 0;
            foreach (byte[] part in parts)
            {
                Buffer.BlockCopy(part, 0, joined, at, part.Length);
                at += part.Length;
            }
            return joined;
        }
    }
}
