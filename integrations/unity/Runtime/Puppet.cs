using System;
using System.Collections.Generic;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>How the service sends a character.</summary>
    public enum PuppetMode
    {
        /// <summary>80 transforms per frame, blended on the graphics card or on the CPU.</summary>
        Controls,

        /// <summary>Positions and normals: 24 bytes per vertex and frame.</summary>
        Vertices,

        /// <summary>Quantised positions and normals: 10 bytes per vertex and frame.</summary>
        Vertices16,

        /// <summary>Weights for the blend shapes of an imported .glb from <c>puppetline bake</c>.</summary>
        Morphs,
    }

    /// <summary>
    /// Shows a character of <c>puppetline serve</c>. Host, port, token, character and mode take effect when the component
    /// is enabled; call <see cref="Reconnect"/> after you change them.
    /// </summary>
    [AddComponentMenu("Puppetline/Puppet")]
    [DisallowMultipleComponent]
    public sealed class Puppet : MonoBehaviour
    {
        /// <summary>Host name or address of the service.</summary>
        [Tooltip("Host name or address of the service.")]
        public string host = "127.0.0.1";

        /// <summary>Port of the stream; the control socket uses the next port.</summary>
        [Tooltip("Port of the stream; the control socket uses the next port.")]
        public int port = 7400;

        /// <summary>The service's token, if it requires one. It is saved with the scene in plain text.</summary>
        [Tooltip("The service's token, if it requires one. It is saved with the scene in plain text.")]
        public string token = "";

        /// <summary>Name of the character; empty for the first one.</summary>
        [Tooltip("Name of the character; empty for the first one.")]
        public string character = "";

        /// <summary>How the service sends the character; docs/unity.md describes the modes.</summary>
        [Tooltip("How the service sends the character; docs/unity.md describes the modes.")]
        public PuppetMode mode = PuppetMode.Controls;

        /// <summary>Delay in seconds, so that motion is even at any display rate; 0 shows the newest frame.</summary>
        [Tooltip("Delay in seconds, so that motion is even at any display rate; 0 shows the newest frame.")]
        [Range(0, 0.5f)]
        public float interpolationDelay = 0.05f;

        /// <summary>One material per part; the last one is used for all remaining parts. Empty for plain ones.</summary>
        [Tooltip("One material per part; the last one is used for all remaining parts. Empty for plain ones.")]
        public Material[] materials = new Material[0];

        /// <summary>Faster normals for controls on the CPU: some degrees off where limbs bend.</summary>
        [Tooltip("Faster normals for controls on the CPU: some degrees off where limbs bend.")]
        public bool quickNormals;

        /// <summary>Morphs: the renderers of the imported .glb; empty for all renderers below this object.</summary>
        [Tooltip("Morphs: the renderers of the imported .glb; empty for all renderers below this object.")]
        public SkinnedMeshRenderer[] skins = new SkinnedMeshRenderer[0];

        /// <summary>Morphs: the object that root motion moves; its name in the .glb is puppetline_root.</summary>
        [Tooltip("Morphs: the object that root motion moves; its name in the .glb is puppetline_root.")]
        public Transform rootNode;

        /// <summary>Events of the connection, the character and the performer.</summary>
        public PuppetEvents events = new PuppetEvents();

        Follower follower;
        ControlClient control;
        Playback playback;
        Scene scene;
        Display display;
        Watch watch;

        /// <summary>State of the connection to the service.</summary>
        public FollowState State => follower == null ? FollowState.Offline : follower.State;

        /// <summary>Description of an error for the user; empty if there is none.</summary>
        public string Reason => follower == null ? "" : follower.Reason;

        /// <summary>Name of the shown character; null before it is known.</summary>
        public string Character => follower?.Character;

        /// <summary>The constant data of the character; null before it has arrived.</summary>
        public Scene Scene => scene;

        /// <summary>The shown frame, valid until the next <c>Update</c>; null before the first frame.</summary>
        public Frame Shown => playback?.Shown;

        /// <summary>The service's status (docs/running.md), at most one second old.</summary>
        public Json Status => follower == null ? Json.Null : follower.Status;

        /// <summary>Whether the graphics card blends the transforms.</summary>
        public bool OnGraphicsCard => display is GraphicsCardDisplay;

        /// <summary>Reconnect with the current values of the fields.</summary>
        public void Reconnect()
        {
            if (isActiveAndEnabled)
            {
                OnDisable();
                OnEnable();
            }
        }

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
                (done ?? WarnOfError)(ControlClient.Failure(command, "a disabled Puppet", "an enabled Puppet", "Enable the component first."));
                return;
            }
            if (control == null)
            {
                control = new ControlClient(host, port + 1, token);
            }
            control.Request(command, arguments, done ?? WarnOfError);
        }

        /// <summary>Compute the pose of a point of the shown character in the world.</summary>
        /// <param name="patch">The point, of the shown scene.</param>
        /// <param name="position">Receives the point.</param>
        /// <param name="rotation">Receives its rotation; y points out of the surface or along the limb.</param>
        /// <returns>False before the first frame, and for morphs, which do not contain positions.</returns>
        public bool TryGetPose(SurfacePatch patch, out Vector3 position, out Quaternion rotation)
        {
            position = Vector3.zero;
            rotation = Quaternion.identity;
            if (Shown == null || !patch.TryEvaluate(Shown, Axes.Unity, out PatchPose pose))
            {
                return false;
            }
            position = transform.TransformPoint(new Vector3(pose.X, pose.Y, pose.Z));
            Vector3 first = transform.TransformVector(new Vector3(pose.FirstX, pose.FirstY, pose.FirstZ));
            Vector3 front = transform.TransformVector(new Vector3(pose.FrontX, pose.FrontY, pose.FrontZ));
            if (patch.InLimb)
            {
                front = Vector3.Cross(Vector3.Cross(first, front), first);
            }
            // In a mirrored space, the cross product points into the surface. Unity's axes are a mirror image themselves.
            float side = Vector3.Dot(transform.TransformVector(Vector3.right), Vector3.Cross(transform.TransformVector(Vector3.up), transform.TransformVector(Vector3.forward)));
            Vector3 up = patch.InLimb ? first : side > 0 ? Vector3.Cross(first, front) : Vector3.Cross(front, first);
            rotation = Quaternion.LookRotation(front, up);
            return true;
        }

        void OnEnable()
        {
            follower = new Follower(host, port, token, character, KindOf(mode));
            playback = new Playback(interpolationDelay, follower.Pool);
            watch = new Watch(this);
        }

        void OnDisable()
        {
            ControlClient stopping = control;
            follower.Dispose();
            display?.Dispose();
            follower = null;
            control = null;
            playback = null;
            scene = null;
            display = null;
            // Both invoke callbacks, which find the component disabled.
            watch.Ended();
            stopping?.Dispose();
        }

        void Update()
        {
            // A listener of any event may disable or reconnect this component; the rest of this update is then void.
            Follower current = follower;
            watch.Connection(current);
            if (follower == current && current.Scene != scene)
            {
                Load(current.Scene);
            }
            if (follower == current)
            {
                TakeFrames();
            }
            if (follower == current)
            {
                control?.Poll();
            }
        }

        void TakeFrames()
        {
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
            else
            {
                display?.Hold();
            }
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

        /// <summary>Return the arguments of a request about the character's stage.</summary>
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
