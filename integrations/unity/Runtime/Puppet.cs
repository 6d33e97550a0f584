using System.Threading;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>
    /// Shows a character of <c>puppetline serve</c>, or plays a clip. Host, port, token, character and mode take effect when
    /// the component is enabled; call <see cref="Reconnect"/> after you change them.
    /// </summary>
    [AddComponentMenu("Puppetline/Puppet")]
    [DisallowMultipleComponent]
    public sealed partial class Puppet : MonoBehaviour
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

        /// <summary>The clock that moves the character.</summary>
        [Tooltip("The clock that moves the character.")]
        public PuppetClock clock = PuppetClock.Realtime;

        /// <summary>A clip that is played instead of a service's stream.</summary>
        [Tooltip("A clip that is played instead of a service's stream.")]
        public PuppetClip clip;

        /// <summary>Shown position of the clip, in seconds.</summary>
        [Tooltip("Shown position of the clip, in seconds.")]
        public float clipPosition;

        /// <summary>Speed of the clips; 0 if the positions are set by a script or an animation.</summary>
        [Tooltip("Speed of the clips; 0 if the positions are set by a script or an animation.")]
        public float clipSpeed = 1;

        /// <summary>Whether the clips begin again after their end.</summary>
        [Tooltip("Whether the clips begin again after their end.")]
        public bool clipLoops = true;

        /// <summary>Another clip of the same character, which is mixed with the clip.</summary>
        [Tooltip("Another clip of the same character, which is mixed with the clip.")]
        public PuppetClip blendClip;

        /// <summary>Shown position of the other clip, in seconds.</summary>
        [Tooltip("Shown position of the other clip, in seconds.")]
        public float blendPosition;

        /// <summary>Weight of the other clip: 0 shows the clip, 1 the other one.</summary>
        [Tooltip("Weight of the other clip: 0 shows the clip, 1 the other one.")]
        [Range(0, 1)]
        public float blendWeight;

        /// <summary>One material per part; the last one is used for all remaining parts. If empty, plain materials are made.</summary>
        [Tooltip("One material per part; the last one is used for all remaining parts. If empty, plain materials are made.")]
        public Material[] materials = new Material[0];

        /// <summary>Faster normals for controls on the CPU: some degrees off where limbs bend.</summary>
        [Tooltip("Faster normals for controls on the CPU: some degrees off where limbs bend.")]
        public bool quickNormals;

        /// <summary>Morphs: the renderers of the imported .glb; empty for all renderers below this object.</summary>
        [Tooltip("Morphs: the renderers of the imported .glb; empty for all renderers below this object.")]
        public SkinnedMeshRenderer[] skins = new SkinnedMeshRenderer[0];

        /// <summary>Morphs: the object that root motion moves, in its axes and units; empty for the object puppetline_root.</summary>
        [Tooltip("Morphs: the object that root motion moves, in its axes and units; empty for the object puppetline_root.")]
        public Transform rootNode;

        /// <summary>Bones: the object above the bones of the rigged model; empty for this object.</summary>
        [Tooltip("Bones: the object above the bones of the rigged model; empty for this object.")]
        public Transform skeleton;

        /// <summary>Bones: names of bones for joints that are not recognised; an empty name leaves a joint out.</summary>
        [Tooltip("Bones: names of bones for joints that are not recognised; an empty name leaves a joint out.")]
        public BoneName[] boneMap = new BoneName[0];

        /// <summary>Bones: whether the hips travel with the character, in proportion to the length of the legs.</summary>
        [Tooltip("Bones: whether the hips travel with the character, in proportion to the length of the legs.")]
        public bool movesHips = true;

        /// <summary>Events of the connection, the character and the performer.</summary>
        public PuppetEvents events = new PuppetEvents();

        /// <summary>Time to wait for the first frame of a recording, and for another one, in seconds.</summary>
        const double FirstFrameSeconds = 20, NextFrameSeconds = 2;

        Follower follower;
        ControlClient control;
        FrameBuffer buffer;
        PuppetClock clockOfBuffer;
        ClipMotion motion;
        Scene scene;
        Frame shown;
        Display display;
        Watch watch;

        /// <summary>Time of the clocks Engine and Manual, in seconds.</summary>
        double time;

        /// <summary>Whether a recording waits for frames: not after a wait without a frame, until one arrives.</summary>
        bool waits;

        /// <summary>Delay that the clock requires, in seconds: in real time, frames arrive irregularly.</summary>
        float Delay => clock == PuppetClock.Manual || Time.captureDeltaTime > 0 ? 0 : interpolationDelay;

        /// <summary>State of the connection to the service.</summary>
        public FollowState State => follower == null ? FollowState.Offline : follower.State;

        /// <summary>Description of an error for the user; empty if there is none.</summary>
        public string Reason => motion != null ? motion.Problem : follower == null ? "" : follower.Reason;

        /// <summary>Name of the shown character; null before it is known.</summary>
        public string Character => motion != null ? motion.Character : follower?.Character;

        /// <summary>The constant data of the character; null before it has arrived.</summary>
        public Scene Scene => scene;

        /// <summary>The shown frame, valid until the next <c>Update</c>; null before the first frame.</summary>
        public Frame Shown => shown;

        /// <summary>The service's status (docs/running.md), at most one second old.</summary>
        public Json Status => follower == null ? Json.Null : follower.Status;

        /// <summary>The kind of frames that are shown; clips contain controls.</summary>
        internal PuppetMode ShownMode => motion != null ? PuppetMode.Controls : mode;

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

        /// <summary>
        /// Move the character on by a time in seconds, with the clock Manual. The next frames are shown immediately.
        /// </summary>
        public void Advance(float seconds)
        {
            if (clock != PuppetClock.Manual)
            {
                Debug.LogWarning("Puppetline: Advance has no effect. Set the clock to Manual first.", this);
                return;
            }
            time += seconds;
            if (motion != null)
            {
                ShowClip(seconds);
            }
            else if (follower != null)
            {
                ShowNext();
            }
        }

        /// <summary>Show a position of a clip immediately, mixed with another clip of the same character.</summary>
        /// <param name="one">The clip.</param>
        /// <param name="position">Position of the clip, in seconds.</param>
        /// <param name="other">The other clip; null for none.</param>
        /// <param name="otherPosition">Position of the other clip, in seconds.</param>
        /// <param name="weight">Weight of the other clip, from 0 to 1.</param>
        public void ShowClips(PuppetClip one, float position, PuppetClip other = null, float otherPosition = 0, float weight = 0)
        {
            clip = one;
            clipPosition = position;
            clipSpeed = 0;
            blendClip = other;
            blendPosition = otherPosition;
            blendWeight = weight;
            if (isActiveAndEnabled && clip != null)
            {
                ReconnectIfChanged();
                ShowClip(0);
            }
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
            watch = new Watch(this);
            if (clip != null)
            {
                motion = new ClipMotion(this);
                return;
            }
            follower = new Follower(host, port, token, character, mode.ToKind());
            NewBuffer();
        }

        void OnDisable()
        {
            ControlClient stopping = control;
            follower?.Dispose();
            display?.Dispose();
            follower = null;
            control = null;
            buffer = null;
            motion = null;
            scene = null;
            shown = null;
            display = null;
            // Both invoke callbacks, which find the component disabled.
            watch.Ended();
            stopping?.Dispose();
        }

        void Update()
        {
            ReconnectIfChanged();
            if (motion != null)
            {
                ShowClip(clock == PuppetClock.Manual ? 0 : Time.deltaTime);
                return;
            }
            // A listener of any event may disable or reconnect this component; the rest of this update is then void.
            Follower current = follower;
            watch.Connection(current);
            if (follower == current)
            {
                Receive();
            }
            if (follower == current && clock == PuppetClock.Engine)
            {
                MoveWithEngine();
            }
            if (follower == current)
            {
                ShowNext();
            }
            if (follower == current)
            {
                control?.Poll();
            }
        }

        void LateUpdate()
        {
            display?.ShowOverAnimations();
        }

        /// <summary>Begin again if a clip has been set or removed.</summary>
        void ReconnectIfChanged()
        {
            if ((clip != null) != (motion != null))
            {
                Reconnect();
            }
        }

        void ShowClip(float seconds)
        {
            motion.Follow();
            motion.Move(seconds);
            ClipMotion current = motion;
            if (current.Scene != null && current.Scene != scene)
            {
                Load(current.Scene);
            }
            // A listener of sceneLoaded may have disabled this component.
            if (motion != current)
            {
                return;
            }
            if (!motion.IsChanged())
            {
                display?.Hold();
                return;
            }
            shown = motion.Evaluate();
            if (shown != null)
            {
                display?.Show(shown);
            }
        }

        /// <summary>Take the scene, and add the frames that have arrived to the buffer.</summary>
        void Receive()
        {
            Follower current = follower;
            if (current.Scene != scene)
            {
                Load(current.Scene);
            }
            if (follower == current)
            {
                buffer.Delay = Delay;
            }
            while (follower == current && follower.TryTake(out Frame frame))
            {
                if (frame.Scene == scene)
                {
                    buffer.Add(frame);
                    waits = true;
                }
                else
                {
                    follower.Pool.Return(frame);
                }
            }
        }

        void MoveWithEngine()
        {
            time += Time.deltaTime;
            var queue = buffer as FrameQueue;
            if (queue != null && Time.captureDeltaTime > 0)
            {
                WaitForFrame();
            }
            else if (queue != null)
            {
                queue.CatchesUp = Time.timeScale == 1;
            }
        }

        /// <summary>Wait until the frames for this image of a recording have arrived: recording is faster or slower than real time.</summary>
        void WaitForFrame()
        {
            Follower current = follower;
            double seconds = shown == null ? FirstFrameSeconds : NextFrameSeconds, end = Clock.Now + seconds;
            ((FrameQueue)buffer).CatchesUp = false;
            while (waits && follower == current && !((FrameQueue)buffer).Reaches(time))
            {
                if (Clock.Now > end)
                {
                    waits = false;
                    Debug.LogWarning("Puppetline: no frame for the recording within " + seconds + " s. Check that the service is sending frames.", this);
                    return;
                }
                Thread.Sleep(1);
                Receive();
            }
        }

        void ShowNext()
        {
            if (clock != clockOfBuffer)
            {
                NewBuffer();
            }
            buffer.Delay = Delay;
            bool changed = buffer.Update(clock == PuppetClock.Realtime ? Clock.Now : time);
            shown = buffer.Shown ?? shown;
            if (changed)
            {
                display?.Show(shown);
                watch.Performer(shown.Header);
            }
            else
            {
                display?.Hold();
            }
        }

        void NewBuffer()
        {
            buffer?.Clear();
            shown = null;
            clockOfBuffer = clock;
            waits = true;
            buffer = clock == PuppetClock.Realtime
                ? new Playback(Delay, follower.Pool)
                : (FrameBuffer)new FrameQueue(Delay, follower.Pool);
        }

        void Load(Scene loaded)
        {
            scene = loaded;
            buffer?.Clear();
            shown = null;
            display?.Dispose();
            display = null;
            display = Display.Make(this, scene);
            events.sceneLoaded.Invoke();
        }
    }
}
