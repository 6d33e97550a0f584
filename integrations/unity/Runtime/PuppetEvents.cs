using System;
using UnityEngine.Events;

namespace Puppetline
{
    /// <summary>What happens to a puppet; all of it is called in its <c>Update</c>.</summary>
    [Serializable]
    public sealed class PuppetEvents
    {
        /// <summary>The service is there.</summary>
        public UnityEvent connected = new UnityEvent();

        /// <summary>The service is gone; it is looked for each second.</summary>
        public UnityEvent disconnected = new UnityEvent();

        /// <summary>The service does not let this client in, and why.</summary>
        public UnityEvent<string> refused = new UnityEvent<string>();

        /// <summary>The character is there, or another one after a reload.</summary>
        public UnityEvent sceneLoaded = new UnityEvent();

        /// <summary>Somebody has come, with the source's number.</summary>
        public UnityEvent<int> performerFound = new UnityEvent<int>();

        /// <summary>The performer moves the character from now on.</summary>
        public UnityEvent<int> performerCalibrated = new UnityEvent<int>();

        /// <summary>The performer has left, or the service is gone.</summary>
        public UnityEvent<int> performerLost = new UnityEvent<int>();

        /// <summary>A take is being recorded, with its name.</summary>
        public UnityEvent<string> takeStarted = new UnityEvent<string>();

        /// <summary>A take is not recorded any more, as far as is known here: the service may be gone.</summary>
        public UnityEvent<string> takeStopped = new UnityEvent<string>();
    }
}
