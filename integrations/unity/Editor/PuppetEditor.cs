using Puppetline.Protocol;
using UnityEditor;
using UnityEngine;

namespace Puppetline.Editing
{
    /// <summary>Inspector of a <see cref="Puppet"/>: its fields, and the state of its connection in play mode.</summary>
    [CustomEditor(typeof(Puppet))]
    public sealed class PuppetEditor : Editor
    {
        /// <inheritdoc/>
        public override void OnInspectorGUI()
        {
            var puppet = (Puppet)target;
            if (Application.isPlaying)
            {
                EditorGUILayout.HelpBox(StatusOf(puppet), puppet.Reason.Length > 0 ? MessageType.Warning : MessageType.Info);
                if (GUILayout.Button("Reconnect"))
                {
                    puppet.Reconnect();
                }
            }
            DrawDefaultInspector();
        }

        /// <inheritdoc/>
        public override bool RequiresConstantRepaint() => Application.isPlaying;

        /// <summary>Return a description of the connection and of what is shown.</summary>
        public static string StatusOf(Puppet puppet)
        {
            string source = puppet.clip != null ? "Clip " + puppet.clip.name : puppet.host + ":" + puppet.port + ": " + puppet.State;
            if (puppet.Reason.Length > 0)
            {
                return source + "\n" + puppet.Reason;
            }
            if (puppet.Scene == null)
            {
                return source;
            }
            string where = puppet.OnGraphicsCard ? "graphics card" : "CPU";
            string performer = puppet.Shown == null || puppet.Shown.Header.User == Header.Nobody ? "no performer" : "performer " + puppet.Shown.Header.User;
            return source + "\n" + puppet.Character + ", " + puppet.Scene.VertexCount + " vertices, " + where + ", " + performer;
        }
    }
}
