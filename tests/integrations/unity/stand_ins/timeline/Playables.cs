// A stand-in: see ../README.md.
using System;
using System.Collections.Generic;

namespace UnityEngine.Playables
{
    public struct PlayableGraph
    {
    }

    public struct FrameData
    {
    }

    /// <summary>A node of the graph, which tests build.</summary>
    public struct Playable
    {
        public readonly Node node;

        public Playable(Node node)
        {
            this.node = node;
        }

        public sealed class Node
        {
            public readonly List<Playable> inputs = new List<Playable>();
            public readonly List<float> weights = new List<float>();
            public PlayableBehaviour behaviour;
            public double time;
        }
    }

    public class PlayableBehaviour
    {
        public virtual void ProcessFrame(Playable playable, FrameData info, object playerData)
        {
        }
    }

    public struct ScriptPlayable<T>
        where T : PlayableBehaviour, new()
    {
        readonly Playable playable;

        ScriptPlayable(Playable playable)
        {
            this.playable = playable;
        }

        public static ScriptPlayable<T> Create(PlayableGraph graph, int inputCount = 0)
        {
            return new ScriptPlayable<T>(new Playable(new Playable.Node { behaviour = new T() }));
        }

        public T GetBehaviour() => (T)playable.node.behaviour;

        public static implicit operator Playable(ScriptPlayable<T> playable) => playable.playable;

        public static explicit operator ScriptPlayable<T>(Playable playable) => new ScriptPlayable<T>(playable);
    }

    public static class PlayableExtensions
    {
        public static int GetInputCount(this Playable playable) => playable.node.inputs.Count;

        public static float GetInputWeight(this Playable playable, int inputIndex) => playable.node.weights[inputIndex];

        public static Playable GetInput(this Playable playable, int inputPort) => playable.node.inputs[inputPort];

        public static double GetTime(this Playable playable) => playable.node.time;
    }

    public abstract class PlayableAsset : ScriptableObject
    {
        public virtual double duration => 5;

        public abstract Playable CreatePlayable(PlayableGraph graph, GameObject owner);
    }
}

namespace UnityEngine.Timeline
{
    [Flags]
    public enum ClipCaps
    {
        Looping = 1,
        ClipIn = 4,
        SpeedMultiplier = 8,
        Blending = 16,
    }

    public interface ITimelineClipAsset
    {
        ClipCaps clipCaps { get; }
    }

    public abstract class TrackAsset : Playables.PlayableAsset
    {
        public virtual Playables.Playable CreateTrackMixer(Playables.PlayableGraph graph, GameObject go, int inputCount) => default;

        public override Playables.Playable CreatePlayable(Playables.PlayableGraph graph, GameObject go) => default;
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class TrackColorAttribute : Attribute
    {
        public TrackColorAttribute(float r, float g, float b)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class TrackBindingTypeAttribute : Attribute
    {
        public TrackBindingTypeAttribute(Type type)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class TrackClipTypeAttribute : Attribute
    {
        public TrackClipTypeAttribute(Type clipClass)
        {
        }
    }
}
