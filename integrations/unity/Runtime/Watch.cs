using System.Collections.Generic;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>Detects changes of the connection, performer and takes; invokes events and logs a warning for each error.</summary>
    sealed class Watch
    {
        readonly Puppet puppet;
        List<string> takes = new List<string>();
        FollowState state = FollowState.Offline;
        string reason = "";
        Json status = Json.Null;
        int performer = Header.Nobody;
        bool calibrated;

        public Watch(Puppet puppet)
        {
            this.puppet = puppet;
        }

        public void Connection(Follower follower)
        {
            Become(follower.State, follower.Reason);
            if (state == FollowState.Connected && follower.Status != status)
            {
                status = follower.Status;
                Takes(status["stages"], puppet.Stage);
            }
        }

        public void Performer(Header header)
        {
            if (state != FollowState.Connected)
            {
                // The shown frame arrived before the connection was lost.
                return;
            }
            bool performing = header.State == PerformerState.Performing;
            int now = performing || header.State == PerformerState.Calibrating ? header.User : Header.Nobody;
            if (now != performer)
            {
                Lose();
            }
            if (now != performer && now != Header.Nobody)
            {
                puppet.events.performerFound.Invoke(now);
            }
            if (performing && !(calibrated && now == performer))
            {
                puppet.events.performerCalibrated.Invoke(now);
            }
            performer = now;
            calibrated = performing;
        }

        /// <summary>Report that the component has disconnected.</summary>
        public void Ended()
        {
            Become(FollowState.Offline, "");
        }

        void Become(FollowState now, string why)
        {
            FollowState before = state;
            state = now;
            if (why != reason && why.Length > 0)
            {
                Debug.LogWarning("Puppetline: " + why, puppet);
            }
            reason = why;
            if (now == FollowState.Connected && before != FollowState.Connected)
            {
                puppet.events.connected.Invoke();
            }
            if (now != FollowState.Connected && before == FollowState.Connected)
            {
                Lose();
                Takes(Json.Null, "");
                puppet.events.disconnected.Invoke();
            }
            if (now == FollowState.Refused && before != FollowState.Refused)
            {
                puppet.events.refused.Invoke(why);
            }
        }

        void Lose()
        {
            int lost = performer;
            performer = Header.Nobody;
            calibrated = false;
            if (lost != Header.Nobody)
            {
                puppet.events.performerLost.Invoke(lost);
            }
        }

        /// <summary>Report takes of the character's stage that have started or stopped.</summary>
        void Takes(Json stages, string stage)
        {
            var now = new List<string>();
            for (int i = 0; i < stages.Count; i++)
            {
                string take = stages[i]["recording"].Text;
                if (take.Length > 0 && (stage.Length == 0 || stages[i]["name"].Text == stage))
                {
                    now.Add(take);
                }
            }
            List<string> before = takes;
            takes = now;
            foreach (string take in before)
            {
                if (!now.Contains(take))
                {
                    puppet.events.takeStopped.Invoke(take);
                }
            }
            foreach (string take in now)
            {
                if (!before.Contains(take))
                {
                    puppet.events.takeStarted.Invoke(take);
                }
            }
        }
    }
}
