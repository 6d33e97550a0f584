using System;

namespace Puppetline.Protocol
{
    /// <summary>A connection failed or was lost, or the peer does not support ZMTP. The client can retry.</summary>
    public class ZmtpException : Exception
    {
        /// <summary>Make an exception with a message.</summary>
        public ZmtpException(string message)
            : base(message)
        {
        }
    }

    /// <summary>The peer refuses the connection. Retrying does not help without a change.</summary>
    public sealed class RefusedException : ZmtpException
    {
        /// <summary>Make an exception with the reason.</summary>
        public RefusedException(string message)
            : base(message)
        {
        }
    }
}
