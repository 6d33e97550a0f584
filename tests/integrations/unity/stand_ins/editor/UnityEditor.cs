// A stand-in: see ../README.md.
using System;
using System.IO;
using System.Linq;
using UnityEditor.AssetImporters;
using UnityEngine;

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Class)]
    public sealed class CustomEditor : Attribute
    {
        public CustomEditor(Type inspectedType)
        {
        }
    }

    public class Editor : ScriptableObject
    {
        public UnityEngine.Object target { get; set; }

        public virtual void OnInspectorGUI()
        {
        }

        public virtual bool RequiresConstantRepaint() => false;

        public bool DrawDefaultInspector() => false;
    }

    public enum MessageType
    {
        None,
        Info,
        Warning,
        Error,
    }

    public static class EditorGUILayout
    {
        public static string shown = "";

        public static void HelpBox(string message, MessageType type) => shown = type + ": " + message;
    }

    public static class ShaderUtil
    {
        public static bool ShaderHasError(Shader s) => false;
    }

    /// <summary>Imports the files of the package each time.</summary>
    public static class AssetDatabase
    {
        public static string package = "";

        public static T LoadAssetAtPath<T>(string assetPath)
            where T : UnityEngine.Object
        {
            string file = Path.Combine(package, assetPath.Substring("Packages/com.puppetline.unity/".Length));
            foreach (Type type in AppDomain.CurrentDomain.GetAssemblies().SelectMany(assembly => assembly.GetTypes()))
            {
                var attribute = (ScriptedImporterAttribute)Attribute.GetCustomAttribute(type, typeof(ScriptedImporterAttribute));
                if (attribute != null && "." + attribute.ext == Path.GetExtension(file))
                {
                    var context = new AssetImportContext(file);
                    ((ScriptedImporter)Activator.CreateInstance(type)).OnImportAsset(context);
                    return context.main as T;
                }
            }
            return null;
        }
    }
}

namespace UnityEditor.AssetImporters
{
    [AttributeUsage(AttributeTargets.Class)]
    public sealed class ScriptedImporterAttribute : Attribute
    {
        public readonly string ext;

        public ScriptedImporterAttribute(int version, string ext)
        {
            this.ext = ext;
        }
    }

    public abstract class ScriptedImporter : UnityEngine.Object
    {
        public abstract void OnImportAsset(AssetImportContext ctx);
    }

    public sealed class AssetImportContext
    {
        public readonly System.Collections.Generic.List<UnityEngine.Object> objects = new System.Collections.Generic.List<UnityEngine.Object>();
        public UnityEngine.Object main;
        public string error = "";

        public AssetImportContext(string assetPath)
        {
            this.assetPath = assetPath;
        }

        public string assetPath { get; }

        public void AddObjectToAsset(string identifier, UnityEngine.Object obj) => objects.Add(obj);

        public void SetMainObject(UnityEngine.Object obj) => main = objects.Contains(obj) ? obj : null;

        public void LogImportError(string msg) => error = msg;
    }
}
