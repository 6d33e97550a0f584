using System;
using System.Collections.Generic;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    // The requests to the service.
    public sealed partial class Puppet
    {
        /// <summary>Calibrate again: map the performer's current pose to the character's rest pose.</summary>
        public void Calibrate()
        {
            Request("calibrate", new Dictionary<string, object> { { "character", Character } });
        }

        /// <summary>Let the performer's left side move the character's right side (true) or its left side (false).</summary>
        public void SetMirror(bool on)
        {
            Request("mirror", new Dictionary<string, object> { { "character", Character }, { "on", on } });
        }

        /// <summary>Start to record a take; with null, the service chooses the name.</summary>
        public void StartRecording(string take = null)
        {
            Dictionary<string, object> arguments = OfStage();
            if (take != null)
            {
                arguments["name"] = take;
            }
            Request("record_start", arguments);
        }

        /// <summary>Finish the take that is being recorded.</summary>
        public void StopRecording()
        {
            Request("record_stop", OfStage());
        }

        /// <summary>Name of the character's stage; empty before the service's status has arrived.</summary>
        public string Stage
        {
            get
            {
                Json characters = Status["characters"];
                for (int i = 0; i < characters.Count; i++)
                {
                    if (characters[i]["name"].Text == Character)
                    {
                        return characters[i]["stage"].Text;
                    }
                }
                return "";
            }
        }

        /// <summary>Send a request to the service (docs/control.md).</summary>
        /// <param name="command">Name of the command.</param>
        /// <param name="arguments">Arguments of the command: strings, numbers, booleans, null.</param>
        /// <param name="done">
        /// Called with the reply in an <c>Update</c>. If the component is disabled, now or before the reply arrives, it is
        /// immediately called with an error. Without a callback, an error becomes a warning.
        /// </param>
        public void Request(string command, IDictionary<string, object> arguments = null, Action<Json> done = null)
        {
            if (follower == null)
            {
                (done ?? WarnOfError)(motion == null
                    ? ControlClient.Failure(command, "a disabled Puppet", "an enabled Puppet", "Enable the component first.")
                    : ControlClient.Failure(command, "a Puppet that plays a clip", "a Puppet of a service", "Remove the clip first."));
                return;
            }
            if (control == null)
            {
                control = new ControlClient(host, port + 1, token);
            }
            control.Request(command, arguments, done ?? WarnOfError);
        }

        /// <summary>Return the arguments of a request for the character's stage.</summary>
        Dictionary<string, object> OfStage()
        {
            var arguments = new Dictionary<string, object>();
            if (Stage.Length > 0)
            {
                arguments["stage"] = Stage;
            }
            return arguments;
        }

        void WarnOfError(Json reply)
        {
            Json error = reply["error"];
            if (!reply["ok"].True)
            {
                Debug.LogWarning(
                    "Puppetline: " + error["where"].Text + ": found " + error["found"].Text + "; expected " + error["expected"].Text + ". " + error["fix"].Text,
                    this);
            }
        }
    }
}
