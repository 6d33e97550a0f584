// A stand-in: see README.md.
using System.Reflection;

namespace UnityEngine
{
    /// <summary>Calls the methods of components by name, as Unity does.</summary>
    public static class Player
    {
        public static void Call(MonoBehaviour component, string message)
        {
            const BindingFlags Any = BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic;
            component.GetType().GetMethod(message, Any)?.Invoke(component, null);
        }

        public static void Enable(MonoBehaviour component, bool enabled)
        {
            component.enabled = enabled;
            Call(component, enabled ? "OnEnable" : "OnDisable");
        }
    }
}
