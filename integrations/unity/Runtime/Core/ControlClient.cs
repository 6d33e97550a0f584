using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;
using System.Threading;

namespace Puppetline
{
    /// <summary>
    /// Asks the service to do something (docs/control.md), on a thread of its own. There is a connection for as long as
    /// there are requests without a reply.
    /// </summary>
    public sealed class ControlClient : IDisposable
    {
        /// <summary>Seconds after which a request without a reply has failed.</summary>
        public const double Patience = 5;

        /// <summary>Requests that may wait for their reply at once; the service would lose those above.</summary>
        public const int MostPending = 16;

        const int LargestReply = 8 << 20;
        const int Nap = 10;

        readonly string host, token;
        readonly int port;
        readonly AutoResetEvent wake = new AutoResetEvent(false);
        readonly object gate = new object();
        readonly Queue<Pending> waiting = new Queue<Pending>();
        readonly Queue<KeyValuePair<Action<Json>, Json>> answered = new Queue<KeyValuePair<Action<Json>, Json>>();
        readonly Dictionary<double, Pending> sent = new Dictionary<double, Pending>();
        int last;
        volatile bool ended;

        /// <summary>Begin; nothing is sent yet.</summary>
        /// <param name="host">A name or an address.</param>
        /// <param name="port">The control socket's port, 7401 as a rule.</param>
        /// <param name="token">The service's token; null or empty if it has none.</param>
        public ControlClient(string host, int port, string token)
        {
            this.host = host;
            this.port = port;
            this.token = token;
            new Thread(Run) { IsBackground = true, Name = "Puppetline control " + host + ":" + port }.Start();
        }

        /// <summary>Ask for something.</summary>
        /// <param name="command">What is to be done, such as calibrate.</param>
        /// <param name="arguments">What the command takes: texts, numbers, booleans, null.</param>
        /// <param name="done">
        /// Called by <see cref="Poll"/> with the reply, which has ok, and result or error; where there was none, with an error
        /// made here. May be null.
        /// </param>
        /// <exception cref="ObjectDisposedException">It was ended.</exception>
        public void Request(string command, IDictionary<string, object> arguments, Action<Json> done)
        {
            lock (gate)
            {
                if (ended)
                {
                    throw new ObjectDisposedException(nameof(ControlClient));
                }
                last++;
                waiting.Enqueue(new Pending { Id = last, Done = done, Until = Clock.Now + Patience, Text = Write(last, command, arguments) });
            }
            wake.Set();
        }

        /// <summary>Hand out the replies that have come, on the thread that calls this.</summary>
        public void Poll()
        {
            while (true)
            {
                KeyValuePair<Action<Json>, Json> next;
                lock (gate)
                {
                    if (answered.Count == 0)
                    {
                        return;
                    }
                    next = answered.Dequeue();
                }
                next.Key(next.Value);
            }
        }

        /// <summary>End it. What was not sent is not; requests without a reply get an error, on the thread that calls this.</summary>
        public void Dispose()
        {
            lock (gate)
            {
                ended = true;
                FailAll("the connection was ended here");
            }
            wake.Set();
            Poll();
        }

        /// <summary>Make a reply with an error, as the service would write it.</summary>
        /// <param name="where">What it is about.</param>
        /// <param name="found">What is wrong.</param>
        /// <param name="expected">What would be right.</param>
        /// <param name="fix">What to do.</param>
        public static Json Failure(string where, string found, string expected, string fix)
        {
            return Json.Parse(
                "{\"ok\":false,\"error\":{\"where\":" + Quoted(where) + ",\"found\":" + Quoted(found)
                + ",\"expected\":" + Quoted(expected) + ",\"fix\":" + Quoted(fix) + "}}");
        }

        static string Write(int id, string command, IDictionary<string, object> arguments)
        {
            var text = new StringBuilder("{\"id\":").Append(id).Append(",\"do\":").Append(Literal(command));
            foreach (KeyValuePair<string, object> argument in arguments ?? new Dictionary<string, object>())
            {
                text.Append(',').Append(Literal(argument.Key)).Append(':').Append(Literal(argument.Value));
            }
            return text.Append('}').ToString();
        }

        static string Literal(object value)
        {
            if (value is string text)
            {
                return Quoted(text);
            }
            if (value is bool truth)
            {
                return truth ? "true" : "false";
            }
            if (value is IFormattable number)
            {
                return number.ToString(null, CultureInfo.InvariantCulture);
            }
            return value == null
                ? "null"
                : throw new ArgumentException("a request takes texts, numbers, booleans and null, not " + value.GetType());
        }

        static string Quoted(string text)
        {
            var quoted = new StringBuilder("\"");
            foreach (char letter in text)
            {
                if (letter == '"' || letter == '\\')
                {
                    quoted.Append('\\').Append(letter);
                }
                else if (letter < ' ')
                {
                    quoted.Append("\\u").Append(((int)letter).ToString("x4", CultureInfo.InvariantCulture));
                }
                else
                {
                    quoted.Append(letter);
                }
            }
            return quoted.Append('"').ToString();
        }

        void Run()
        {
            while (!ended)
            {
                wake.WaitOne();
                try
                {
                    Serve();
                }
                catch (Exception fault)
                {
                    FailAll(fault is ZmtpException ? fault.Message : fault.ToString());
                }
            }
        }

        void Serve()
        {
            if (!IsWaiting())
            {
                return;
            }
            using (ZmtpConnection connection = ZmtpConnection.Open(host, port, "DEALER", token, LargestReply))
            {
                while (!ended && (IsWaiting() || sent.Count > 0))
                {
                    SendWaiting(connection);
                    if (connection.Receive(Nap, out ArraySegment<byte> reply))
                    {
                        Answer(reply);
                    }
                    FailLate();
                }
            }
        }

        bool IsWaiting()
        {
            lock (gate)
            {
                return waiting.Count > 0;
            }
        }

        void SendWaiting(ZmtpConnection connection)
        {
            while (sent.Count < MostPending)
            {
                Pending next;
                lock (gate)
                {
                    if (waiting.Count == 0)
                    {
                        return;
                    }
                    next = waiting.Dequeue();
                    sent.Add(next.Id, next);
                }
                connection.Send(Encoding.UTF8.GetBytes(next.Text));
            }
        }

        void Answer(ArraySegment<byte> bytes)
        {
            Json reply;
            try
            {
                reply = Json.Parse(bytes);
            }
            catch (FormatException)
            {
                return;
            }
            lock (gate)
            {
                if (reply["id"].Kind == JsonKind.Number && sent.TryGetValue(reply["id"].Number, out Pending request))
                {
                    Finish(request, reply);
                }
            }
        }

        void FailLate()
        {
            lock (gate)
            {
                foreach (Pending request in new List<Pending>(sent.Values))
                {
                    if (Clock.Now > request.Until)
                    {
                        Finish(request, Failure("no reply within " + Patience + " s"));
                    }
                }
            }
        }

        /// <summary>What was asked may have been done or not, so it is not asked again.</summary>
        void FailAll(string found)
        {
            lock (gate)
            {
                while (waiting.Count > 0)
                {
                    Pending next = waiting.Dequeue();
                    sent.Add(next.Id, next);
                }
                foreach (Pending request in new List<Pending>(sent.Values))
                {
                    Finish(request, Failure(found));
                }
            }
        }

        /// <summary>Called with the gate held: so each request is answered once, whoever ends it.</summary>
        void Finish(Pending request, Json reply)
        {
            sent.Remove(request.Id);
            if (request.Done != null)
            {
                answered.Enqueue(new KeyValuePair<Action<Json>, Json>(request.Done, reply));
            }
        }

        Json Failure(string found)
        {
            return Failure("the control socket " + host + ":" + port, found, "a reply", "See that puppetline serve runs there.");
        }

        sealed class Pending
        {
            public int Id;
            public string Text;
            public double Until;
            public Action<Json> Done;
        }
    }
}
