using System;
using System.Net;
using System.Net.Sockets;
using System.Text;

namespace Puppetline
{
    /// <summary>A connection could not be made, was lost, or the other side does not speak ZMTP. One may try again.</summary>
    public class ZmtpException : Exception
    {
        /// <summary>Say what was wrong.</summary>
        public ZmtpException(string message)
            : base(message)
        {
        }
    }

    /// <summary>The other side does not let this client in. Trying again is of no use before something was changed.</summary>
    public sealed class RefusedException : ZmtpException
    {
        /// <summary>Say why.</summary>
        public RefusedException(string message)
            : base(message)
        {
        }
    }

    /// <summary>
    /// ZMTP 3 over TCP, as much of it as the service needs: one peer, messages of one part, mechanism NULL or PLAIN.
    /// Opening one and sending wait for the network, so all of it belongs on a thread of its own.
    /// </summary>
    public sealed class ZmtpConnection : IDisposable
    {
        const int ConnectPatience = 2000;
        const int HandshakePatience = 5000;
        const int Greeting = 64, Signature = 10;
        const int LargestCommand = 65536;
        const byte More = 1, Long = 2, Command = 4;

        readonly Socket socket;
        readonly string where;
        byte[] buffer = new byte[16384];
        int start, end;

        /// <summary>Bytes, with its head, of the frame that begins at start; 0 as long as that is not known.</summary>
        int expected;

        int largest = LargestCommand;

        ZmtpConnection(Socket socket, string where)
        {
            this.socket = socket;
            this.where = where;
        }

        /// <summary>When bytes came last, by <see cref="Clock"/>: of a long message, long before it is whole.</summary>
        public double Heard { get; private set; }

        /// <summary>Connect and shake hands.</summary>
        /// <param name="host">A name or an address.</param>
        /// <param name="port">A TCP port.</param>
        /// <param name="socketType">SUB or DEALER.</param>
        /// <param name="token">The password of PLAIN; null or empty for NULL.</param>
        /// <param name="largestMessage">Bytes; a larger message ends the connection before it takes any memory.</param>
        /// <exception cref="RefusedException">The token is wrong, missing, or one too many.</exception>
        /// <exception cref="ZmtpException">Anything else that went wrong.</exception>
        public static ZmtpConnection Open(string host, int port, string socketType, string token, int largestMessage)
        {
            string where = host + ":" + port;
            var connection = new ZmtpConnection(Connect(host, port, where), where);
            try
            {
                connection.ShakeHands(socketType, token ?? "");
                connection.largest = largestMessage;
                return connection;
            }
            catch
            {
                connection.Dispose();
                throw;
            }
        }

        /// <summary>Wait for the next message. It lies in a buffer of the connection until the next call.</summary>
        /// <param name="milliseconds">How long to wait.</param>
        /// <param name="message">The body.</param>
        /// <returns>False if none has come whole in that time.</returns>
        /// <exception cref="ZmtpException">The connection is lost, or what came is none of ZMTP.</exception>
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
                    throw new ZmtpException(where + " sends messages of several parts, which Puppetline does not");
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

        /// <summary>Ask for the messages of exactly this topic.</summary>
        /// <exception cref="ZmtpException">The connection is lost.</exception>
        public void Subscribe(string topic)
        {
            Send(Encoding.ASCII.GetBytes("\u0001" + topic + "\0"));
        }

        /// <summary>Ask for no more messages of this topic.</summary>
        /// <exception cref="ZmtpException">The connection is lost.</exception>
        public void Unsubscribe(string topic)
        {
            Send(Encoding.ASCII.GetBytes("\0" + topic + "\0"));
        }

        /// <summary>Close it.</summary>
        public void Dispose()
        {
            socket.Close();
        }

        static Socket Connect(string host, int port, string where)
        {
            string reason = "has no address";
            foreach (IPAddress address in Addresses(host))
            {
                var socket = new Socket(address.AddressFamily, SocketType.Stream, ProtocolType.Tcp);
                try
                {
                    IAsyncResult connecting = socket.BeginConnect(address, port, null, null);
                    if (connecting.AsyncWaitHandle.WaitOne(ConnectPatience))
                    {
                        socket.EndConnect(connecting);
                        socket.NoDelay = true;
                        socket.SendTimeout = HandshakePatience;
                        return socket;
                    }
                    reason = "does not answer";
                }
                catch (SocketException fault)
                {
                    reason = fault.Message;
                }
                socket.Close();
            }
            throw new ZmtpException(where + ": " + reason + ". Does puppetline serve run there?");
        }

        static IPAddress[] Addresses(string host)
        {
            try
            {
                return Dns.GetHostAddresses(host);
            }
            catch (SocketException fault)
            {
                throw new ZmtpException(host + ": " + fault.Message);
            }
        }

        void ShakeHands(string socketType, string token)
        {
            int until = Environment.TickCount + HandshakePatience;
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
            var greeting = new byte[Greeting];
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
                while (end - start < Greeting)
                {
                    if (!Fill(until))
                    {
                        throw new ZmtpException(where + " does not greet as ZMTP does. Is it the port of puppetline serve?");
                    }
                }
            }
            catch (ZmtpException) when (end - start >= Signature && buffer[0] == 0xFF)
            {
                // as libzmq does on another mechanism; but also, for all that one knows, a service that just ends
                string token = mechanism == "NULL" ? "Does it want a token?" : "Has it perhaps no token?";
                throw new ZmtpException(where + " has closed the connection during the handshake. " + token);
            }
            if (buffer[0] != 0xFF || buffer[9] != 0x7F || buffer[10] < 3)
            {
                throw new ZmtpException(where + " is something else than ZMTP 3. Is it the port of puppetline serve?");
            }
            string theirs = Encoding.ASCII.GetString(buffer, 12, 20).TrimEnd('\0');
            if (theirs != mechanism)
            {
                throw new RefusedException(where + Mismatch(theirs));
            }
            start += Greeting;
        }

        static string Mismatch(string theirs)
        {
            switch (theirs)
            {
                case "PLAIN":
                    return " lets in nobody without its token. Set it.";
                case "NULL":
                    return " has no token. Leave it empty.";
                default:
                    return " wants the mechanism " + theirs + ", which this client does not have. Serve with a token, or on this machine.";
            }
        }

        void Await(int until, string name)
        {
            if (!ReadFrame(until, out byte flags, out ArraySegment<byte> body))
            {
                throw new ZmtpException(where + " does not finish the handshake");
            }
            if (IsError(flags, body))
            {
                throw new RefusedException(where + " does not accept the token. Is it that of the service?");
            }
            if ((flags & Command) == 0 || !Begins(body, name))
            {
                throw new ZmtpException(where + " does not shake hands as ZMTP does. Is it the port of puppetline serve?");
            }
        }

        /// <summary>Tell an ERROR, whose first byte is wrong in libzmq 4.3.5.</summary>
        static bool IsError(byte flags, ArraySegment<byte> body)
        {
            return (flags & Command) != 0 && (Begins(body, "ERROR") || Begins(body, "RROR", 0x5E));
        }

        void Answer(ArraySegment<byte> command)
        {
            const int PingHead = 7, MostContext = 16;
            if (IsError(Command, command))
            {
                throw new RefusedException(where + " has ended the connection");
            }
            if (Begins(command, "PING") && command.Count >= PingHead && command.Count <= PingHead + MostContext)
            {
                var context = new byte[command.Count - PingHead];
                Buffer.BlockCopy(command.Array, command.Offset + PingHead, context, 0, context.Length);
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

        /// <summary>Wait for a whole frame; what belongs to one that is not whole yet stays for the next call.</summary>
        bool ReadFrame(int until, out byte flags, out ArraySegment<byte> body)
        {
            while (!Whole(out flags, out body))
            {
                if (!Fill(until))
                {
                    return false;
                }
            }
            return true;
        }

        bool Whole(out byte flags, out ArraySegment<byte> body)
        {
            flags = end > start ? buffer[start] : (byte)0;
            body = default;
            int head = (flags & Long) != 0 ? 9 : 2;
            if ((flags & ~(More | Long | Command)) != 0)
            {
                throw new ZmtpException(where + " sends something else than ZMTP");
            }
            if (end - start < head)
            {
                return false;
            }
            ulong size = Size(head);
            if (size > (ulong)largest)
            {
                throw new ZmtpException(where + " sends a message of " + size + " bytes; at most " + largest + " are taken");
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

        /// <summary>Wait for more bytes; false if none came in time.</summary>
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
            catch (SocketException fault)
            {
                throw new ZmtpException(where + ": " + fault.Message);
            }
        }

        /// <summary>Make room for at least one byte: no more than twice what has really come, whatever was announced.</summary>
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
            catch (SocketException fault)
            {
                throw new ZmtpException(where + ": " + fault.Message);
            }
        }

        static byte[] BigEndian(int number)
        {
            return new[] { (byte)(number >> 24), (byte)(number >> 16), (byte)(number >> 8), (byte)number };
        }

        /// <summary>Return a text with its length before it.</summary>
        static byte[] Short(string text)
        {
            byte[] bytes = Encoding.UTF8.GetBytes(text);
            return bytes.Length < 256 ? Join(new[] { (byte)bytes.Length }, bytes) : throw new RefusedException("a token of more than 255 bytes");
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
