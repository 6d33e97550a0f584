using System;
using System.Collections.Generic;
using UnityEngine;

namespace Puppetline
{
    /// <summary>As what a character comes.</summary>
    public enum PuppetMode
    {
        /// <summary>80 transforms a frame, blended on the graphics card or on the processor.</summary>
        Controls,

        /// <summary>Positions and normals: 24 bytes a vertex and frame.</summary>
        Vertices,

        /// <summary>Positions and normals, quantised: 10 bytes a vertex and frame.</summary>
        Vertices16,

        /// <summary>Weights for the blend shapes of an imported .glb, as made by <c>puppetline bake</c>.</summary>
        Morphs,
    }

    /// <summary>
    /// Shows a character of <c>puppetline serve</c>. Fields that say whom to follow count when the component is enabled:
    /// call <see cref="Reconnect"/> after changing them.
    /// </summary>
    [AddComponentMenu("Puppetline/Puppet")]
    [DisallowMultipleComponent]
    public sealed class Puppet : MonoBehaviour
    {
        /// <summary>Where the service runs: a name or an address.</summary>
        [Tooltip("Where the service runs: a name or an address.")]
        public string host = "127.0.0.1";

        /// <summary>The stream's port. The control socket is at the next one.</summary>
        [Tooltip("The stream's port. The control socket is at the next one.")]
        public int port = 7400;

        /// <summary>The service's token, if it has one. What stands here is stored readably with the scene.</summary>
        [Tooltip("The service's token, if it has one. What stands here is stored readably with the scene.")]
        public string token = "";

        /// <summary>Which character; empty for the first one.</summary>
        [Tooltip("Which character; empty for the first one.")]
        public string character = "";

        /// <summary>As what it comes.</summary>
        [Tooltip("As what the character comes: docs/unity.md says which is for what.")]
        public PuppetMode mode = PuppetMode.Controls;

        /// <summary>Seconds that frames are shown late, so that motion is even; 0 shows the newest one.</summary>
        [Tooltip("Seconds that frames are shown late, so that motion is even; 0 shows the newest one.")]
        [Range(0, 0.5f)]
        public float interpolationDelay = 0.05f;

        /// <summary>One for each part of the character, the last one for all that are left; none for plain ones.</summary>
        [Tooltip("One for each part of the character, the last one for all that are left; none for plain ones.")]
        public Material[] materials = new Material[0];

        /// <summary>Normals of controls on the processor: quicker, some degrees off where limbs bend.</summary>
        [Tooltip("Normals of controls on the processor: quicker, some degrees off where limbs bend.")]
        public bool quickNormals;

        /// <summary>Morphs: the renderers of the imported .glb; none for all below this one.</summary>
        [Tooltip("Morphs: the renderers of the imported .glb; none for all below this one.")]
        public SkinnedMeshRenderer[] skins = new SkinnedMeshRenderer[0];

        /// <summary>Morphs: what is moved by how far the performer has walked; the .glb calls it puppetline_root.</summary>
        [Tooltip("Morphs: what is moved by how far the performer has walked; the .glb calls it puppetline_root.")]
        public Transform rootNode;

        /// <summary>What happens.</summary>
        public PuppetEvents events = new PuppetEvents();

        Follower follower;
        ControlClient control;
        Playback playback;
        Scene scene;
        Display display;
        Watch watch;

        /// <summary>How it stands with the service.</summary>
        public FollowState State => follower == null ? FollowState.Offline : follower.State;

        /// <summary>What is wrong, for people; empty if nothing is.</summary>
        public string Reason => follower == null ? "" : follower.Reason;

        /// <summary>The name of the character that is shown; null before one is known.</summary>
        public string Character => follower?.Character;

        /// <summary>What does not change of it; null before it has come.</summary>
        public Scene Scene => scene;

        /// <summary>The moment that is shown, good until the next <c>Update</c>; null before one has come.</summary>
        public Frame Shown => playback?.Shown;

        /// <summary>The service's status (docs/running.md), a second old at most.</summary>
        public Json Status => follower == null ? Json.Null : follower.Status;

        /// <summary>Whether the graphics card blends the transforms.</summary>
        public bool OnGraphicsCard => display is GraphicsCardDisplay;

        /// <summary>Connect anew, by what the fields say now.</summary>
        public void Reconnect()
        {
            if (isActiveAndEnabled)
            {
                OnDisable();
                OnEnable();
            }
        }

        /// <summary>Take the performer's pose as it is now for the character's rest pose.</summary>
        public void Calibrate()
        {
            Request("calibrate", new Dictionary<string, object> { { "character", Character } });
        }

        /// <summary>Let the performer's left move the character's right, or its left.</summary>
        public void SetMirror(bool on)
        {
            Request("mirror", new Dictionary<string, object> { { "character", Character }, { "on", on } });
        }

        /// <summary>Record a take; null lets the service name it.</summary>
        public void StartRecording(string take = null)
        {
            Request("record_start", take == null ? null : new Dictionary<string, object> { { "name", take } });
        }

        /// <summary>End the recording.</summary>
        public void StopRecording()
        {
            Request("record_stop");
        }

        /// <summary>Ask the service for something (docs/control.md).</summary>
        /// <param name="command">What is to be done.</param>
        /// <param name="arguments">What the command takes: texts, numbers, booleans, null.</param>
        /// <param name="done">
        /// Gets the reply in an <c>Update</c>, or an error at once where the component is disabled, now or before there is a
        /// reply; without it, an error becomes a warning.
        /// </param>
        public void Request(string command, IDictionary<string, object> arguments = null, Action<Json> done = null)
        {
            if (follower == null)
            {
                (done ?? Complain)(ControlClient.Failure(command, "a disabled Puppet", "an enabled one", "Enable it before asking."));
                return;
            }
            if (control == null)
            {
                control = new ControlClient(host, port + 1, token);
            }
            control.Request(command, arguments, done ?? Complain);
        }

        void OnEnable()
        {
            follower = new Follower(host, port, token, character, KindOf(mode));
            playback = new Playback(interpolationDelay, follower.Pool);
            watch = new Watch(this);
        }

        void OnDisable()
        {
            ControlClient asked = control;
            follower.Dispose();
            display?.Dispose();
            follower = null;
            control = null;
            playback = null;
            scene = null;
            display = null;
            // both call others, who find it disabled
            watch.Ended();
            asked?.Dispose();
        }

        void Update()
        {
            watch.Connection(follower);
            if (follower.Scene != scene)
            {
                Load(follower.Scene);
            }
            while (follower.TryTake(out Frame frame))
            {
                if (frame.Scene == scene)
                {
                    playback.Add(frame);
                }
                else
                {
                    follower.Pool.Return(frame);
                }
            }
            playback.Delay = interpolationDelay;
            if (playback.Update(Clock.Now))
            {
                display?.Show(playback.Shown);
                watch.Performer(playback.Shown.Header);
            }
            control?.Poll();
        }

        void Load(Scene loaded)
        {
            scene = loaded;
            playback.Clear();
            display?.Dispose();
            display = null;
            display = Display.Make(this, scene);
            events.sceneLoaded.Invoke();
        }

        void Complain(Json reply)
        {
            Json error = reply["error"];
            if (!reply["ok"].True)
            {
                Debug.LogWarning(
                    "Puppetline: " + error["where"].Text + ": found " + error["found"].Text + ", expected " + error["expected"].Text + ". " + error["fix"].Text,
                    this);
            }
        }

        static Kind KindOf(PuppetMode mode)
        {
            switch (mode)
            {
                case PuppetMode.Vertices:
                    return Kind.Vertices;
                case PuppetMode.Vertices16:
                    return Kind.Vertices16;
                case PuppetMode.Morphs:
                    return Kind.Morphs;
                default:
                    return Kind.Controls;
            }
        }
    }
}
