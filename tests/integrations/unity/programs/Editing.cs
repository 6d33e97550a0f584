using System;
using System.IO;
using System.Reflection;
using NUnit.Framework;
using Puppetline;
using Puppetline.Editing;
using UnityEditor;
using UnityEditor.AssetImporters;
using UnityEngine;

/// <summary>Runs the package's own tests, then the importer with a file, and prints the inspector's text for its clip.</summary>
static class Editing
{
    static void Main(string[] arguments)
    {
        Said.Open();
        AssetDatabase.package = arguments[0];
        foreach (MethodInfo method in typeof(PackageTests).GetMethods())
        {
            if (method.GetCustomAttribute<TestAttribute>() != null)
            {
                method.Invoke(new PackageTests(), null);
                Said.Line("passed", method.Name);
            }
        }
        var context = new AssetImportContext(arguments[1]);
        new PuppetClipImporter().OnImportAsset(context);
        Said.Line("imported", context.main.name, "error", context.error);
        Puppet puppet = new GameObject().AddComponent<Puppet>();
        puppet.clip = (PuppetClip)context.main;
        Player.Enable(puppet, true);
        Player.Call(puppet, "Update");
        var inspector = new PuppetEditor { target = puppet };
        inspector.OnInspectorGUI();
        Said.Line("status", EditorGUILayout.shown);
        Player.Enable(puppet, false);
    }
}
