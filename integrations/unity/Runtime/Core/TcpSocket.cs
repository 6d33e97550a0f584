using System;
using System.Net;
using System.Net.Sockets;

namespace Puppetline.Protocol
{
    /// <summary>Opens TCP connections.</summary>
    static class TcpSocket
    {
        const int ConnectTimeoutMilliseconds = 2000;

        /// <summary>Connect to the first address of a host that answers.</summary>
        /// <exception cref="ZmtpException">The host has no address, or none that answers.</exception>
        public static Socket Connect(string host, int port, int sendTimeoutMilliseconds)
        {
            string reason = "has no address";
            foreach (IPAddress address in Addresses(host))
            {
                var socket = new Socket(address.AddressFamily, SocketType.Stream, ProtocolType.Tcp);
                try
                {
                    IAsyncResult connecting = socket.BeginConnect(address, port, null, null);
                    if (connecting.AsyncWaitHandle.WaitOne(ConnectTimeoutMilliseconds))
                    {
                        socket.EndConnect(connecting);
                        socket.NoDelay = true;
                        socket.SendTimeout = sendTimeoutMilliseconds;
                        return socket;
                    }
                    reason = "no answer";
                }
                catch (SocketException error)
                {
                    reason = error.Message;
                }
                socket.Close();
            }
            throw new ZmtpException(host + ":" + port + ": " + reason + ". Check that puppetline serve is running there.");
        }

        static IPAddress[] Addresses(string host)
        {
            try
            {
                return Dns.GetHostAddresses(host);
            }
            catch (SocketException error)
            {
                throw new ZmtpException(host + ": " + error.Message);
            }
        }
    }
}
