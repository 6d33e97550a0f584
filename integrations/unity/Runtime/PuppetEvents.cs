using System;
using Puppetline.Protocol;
using UnityEngine.Events;

namespace Puppetline
{
    /// <summary>Events of a <see cref="Puppet"/>. They are invoked in its <c>Update</c>.</summary>
    [Serializable]
    public sealed class PuppetEvents
    {
        /// <summary>The service is connected.</summary>
        public UnityEvent connected = new UnityEvent();

        /// <summary>The service is disconnected; the component retries every second.</summary>
        public UnityEvent disconnected = new UnityEvent();

        /// <summary>The service refuses the connection, with the reason.</summary>
        public UnityEvent<string> refused = new UnityEvent<string>();

        /// <summary>The character has arrived, or has changed after a reload.</summary>
        public UnityEvent sceneLoaded = new UnityEvent();

        /// <summary>A performer has been found, with the user number.</summary>
        public UnityEvent<int> performerFound = new UnityEvent<int>();

        /// <summary>The performer has been calibrated and drives the character.</summary>
        public UnityEvent<int> performerCalibrated = new UnityEvent<int>();

        /// <summary>The performer has left, or the service is disconnected.</summary>
        public UnityEvent<int> performerLost = new UnityEvent<int>();

        /// <summary>The service records a take, with its name.</summary>
        public UnityEvent<string> takeStarted = new UnityEvent<string>();

        /// <summary>The service has finished a take, or is disconnected.</summary>
        public UnityEvent<string> takeStopped = new UnityEvent<string>();
    }
}
