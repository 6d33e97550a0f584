// A stand-in: see README.md.
using System;
using System.Collections.Generic;
using System.Linq;

namespace UnityEngine
{
    public class Object
    {
        public string name = "";
        public bool destroyed;

        public static implicit operator bool(Object exists) => !IsGone(exists);

        public static bool operator ==(Object a, Object b) => IsGone(a) ? IsGone(b) : ReferenceEquals(a, b);

        public static bool operator !=(Object a, Object b) => !(a == b);

        public static void Destroy(Object gone) => gone.destroyed = true;

        public override bool Equals(object other) => this == other as Object;

        public override int GetHashCode() => 0;

        static bool IsGone(Object any) => ReferenceEquals(any, null) || any.destroyed;
    }

    public class Component : Object
    {
        public GameObject gameObject;

        public Transform transform => gameObject.transform;

        public bool TryGetComponent<T>(out T component)
        {
            component = gameObject.components.OfType<T>().FirstOrDefault();
            return component != null;
        }

        public T[] GetComponentsInChildren<T>() => gameObject.components.OfType<T>().ToArray();
    }

    public class Behaviour : Component
    {
        public bool enabled = true;

        public bool isActiveAndEnabled => enabled;
    }

    public class MonoBehaviour : Behaviour
    {
    }

    public sealed class GameObject : Object
    {
        public readonly List<Component> components = new List<Component>();
        public readonly Transform transform = new Transform();
        public bool active = true;

        public void SetActive(bool value) => active = value;

        public T AddComponent<T>()
            where T : Component
        {
            T made = (T)Activator.CreateInstance(typeof(T));
            made.gameObject = this;
            components.Add(made);
            return made;
        }
    }

    public class Transform : Component
    {
        public Vector3 localPosition, position, lossyScale = new Vector3(1, 1, 1), localScale = new Vector3(1, 1, 1);
        public Quaternion rotation = Quaternion.identity, localRotation = Quaternion.identity;
        public Transform parent;
        readonly List<Transform> children = new List<Transform>();

        public int childCount => children.Count;

        public Transform GetChild(int index) => children[index];

        public void SetParent(Transform above)
        {
            parent = above;
            above.children.Add(this);
        }

        public Vector3 TransformVector(Vector3 vector) => rotation * Vector3.Scale(lossyScale, vector);

        public Vector3 TransformPoint(Vector3 point) => position + TransformVector(point);

        public void SetPositionAndRotation(Vector3 position, Quaternion rotation)
        {
            this.position = position;
            this.rotation = rotation;
        }
    }

    public class ScriptableObject : Object
    {
        public static T CreateInstance<T>()
            where T : ScriptableObject
        {
            return (T)Activator.CreateInstance(typeof(T));
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class SerializeField : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class HideInInspector : Attribute
    {
    }

    /// <summary>The time of the engine, which tests set.</summary>
    public static class Time
    {
        public static float deltaTime, timeScale = 1, captureDeltaTime;
    }

    public static class Application
    {
        public static bool isPlaying = true;
    }

    public static class Debug
    {
        public static readonly List<string> Warnings = new List<string>();

        public static void Log(object message)
        {
        }

        public static void LogWarning(object message, Object context) => Warnings.Add(message.ToString());
    }

    public static class Resources
    {
        public static T Load<T>(string path)
            where T : Object
        {
            T made = (T)Activator.CreateInstance(typeof(T));
            made.name = path;
            return made;
        }
    }

    public enum ColorSpace
    {
        Gamma,
        Linear,
    }

    public static class QualitySettings
    {
        public static ColorSpace activeColorSpace = ColorSpace.Linear;
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class AddComponentMenu : Attribute
    {
        public AddComponentMenu(string menuName)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class DisallowMultipleComponent : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class TooltipAttribute : Attribute
    {
        public TooltipAttribute(string tooltip)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class RangeAttribute : Attribute
    {
        public RangeAttribute(float min, float max)
        {
        }
    }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height)
        {
        }
    }

    public sealed class GUILayoutOption
    {
    }

    public static class GUILayout
    {
        public static void BeginArea(Rect screenRect)
        {
        }

        public static void EndArea()
        {
        }

        public static void Label(string text, params GUILayoutOption[] options)
        {
        }

        /// <summary>Text of the button that is pressed.</summary>
        public static string pressed = "";

        public static bool Button(string text, params GUILayoutOption[] options) => text == pressed;
    }
}

namespace UnityEngine.Events
{
    public delegate void UnityAction();

    public delegate void UnityAction<T0>(T0 arg0);

    public class UnityEvent
    {
        event UnityAction Listeners;

        public void AddListener(UnityAction call) => Listeners += call;

        public void RemoveListener(UnityAction call) => Listeners -= call;

        public void Invoke() => Listeners?.Invoke();
    }

    public class UnityEvent<T0>
    {
        event UnityAction<T0> Listeners;

        public void AddListener(UnityAction<T0> call) => Listeners += call;

        public void RemoveListener(UnityAction<T0> call) => Listeners -= call;

        public void Invoke(T0 arg0) => Listeners?.Invoke(arg0);
    }
}
