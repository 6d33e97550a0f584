using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;
using System.Threading;

namespace Puppetline.Protocol
{
    /// <summary>
    /// Client of the service's control socket (docs/control.md), which works on its own thread. It is connected while
    /// there are requests without a reply.
    /// </summary>
    public sealed class ControlClient : IDisposable
    {
        /// <summary>Time after which a request without a reply fails, in seconds.</summary>
        public const double Patience = 5;

        /// <summary>Maximum number of sent requests without a reply; the service would drop further ones.</summary>
        public const int MostPending = 16;

        /// <summary>Maximum size of a reply, in bytes.</summary>
        const int MaxReplyBytes = 8 << 20;
        
        /// <summary>Time between two checks for new requests while replies are pending, in milliseconds.</summary>
        const int PollMilliseconds = 10;

        readonly string host, token;
        readonly int port;
        readonly AutoResetEvent wake = new AutoResetEvent(false);
        readonly object gate = new object();
        readonly Queue<Pending> waiting = new Queue<Pending>();
        readonly Queue<KeyValuePair<Action<Json>, Json>> answered = new Queue<KeyValuePair<Action<Json>, Json>>();
        readonly Dictionary<double, Pending> sent = new Dictionary<double, Pending>();
        int last;
        volatile bool ended;

        /// <summary>Start the thread. Nothing is sent before the first request.</summary>
        /// <param name="host">A host name or an address.</param>
        /// <param name="port">The control socket's port, usually 7401.</param>
        /// <param name="token">The service's token; null or empty if it has none.</param>
        public ControlClient(string host, int port, string token)
        {
            this.host = host;
            this.port = port;
            this.token = token;
            new Thread(Run) { IsBackground = true, Name = "Puppetline control " + host + ":" + port }.Start();
        }

        /// <summary>Queue a request.</summary>
        /// <param name="command">Name of the command, for example calibrate.</param>
        /// <param name="arguments">Arguments of the command: strings, numbers, booleans, null.</param>
        /// <param name="done">
        /// Called by <see cref="Poll"/> with the reply, which has ok, and result or error. If there is no reply, it is called
        /// with an error of the same form. Can be null.
        /// </param>
        /// <exception cref="ObjectDisposedException">The client has been disposed.</exception>
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

        /// <summary>Call the callbacks of the replies that have arrived, on the calling thread.</summary>
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

        /// <summary>
        /// Stop the client. Queued requests are not sent. Requests without a reply get an error, on the calling thread.
        /// </summary>
        public void Dispose()
        {
            lock (gate)
            {
                ended = true;
                FailAll("a client that has been disposed");
            }
            wake.Set();
            Poll();
        }

        /// <summary>Make a reply with an error, in the form of the service's errors.</summary>
        /// <param name="where">The object of the error.</param>
        /// <param name="found">What was found, as a noun phrase.</param>
        /// <param name="expected">What was expected, as a noun phrase.</param>
        /// <param name="fix">How to fix the error, as an imperative sentence.</param>
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
                : throw new ArgumentException("a request accepts strings, numbers, booleans and null, not " + value.GetType());
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
                catch (Exception error)
                {
                    FailAll(error is ZmtpException ? "no connection (" + error.Message.TrimEnd('.') + ")" : error.ToString());
                }
            }
        }

        void Serve()
        {
            if (!IsWaiting())
            {
                return;
            }
            using (ZmtpConnection connection = ZmtpConnection.Open(host, port, "DEALER", token, MaxReplyBytes))
            {
                while (!ended && (IsWaiting() || sent.Count > 0))
                {
                    SendWaiting(connection);
                    if (connection.Receive(PollMilliseconds, out ArraySegment<byte> reply))
                    {
                        Answer(reply);
                    }
                    FailLateRequests();
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

        void FailLateRequests()
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

        /// <summary>Fail all requests. None is repeated, because the service may have executed it.</summary>
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

        /// <summary>Finish a request. The caller must hold the lock, so that each request is answered only once.</summary>
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
            return Failure("the control socket " + host + ":" + port, found, "a reply", "Check that puppetline serve is running there.");
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
