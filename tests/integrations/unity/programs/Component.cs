using System;
using System.Collections.Generic;
using System.Reflection;
using System.Threading;
using Puppetline;
using Puppetline.Protocol;
using UnityEngine;
using UnityEngine.Rendering;

/// <summary>Runs a Puppet in a stand-in for Unity, executes the commands of standard input, and prints the results.</summary>
static class Component
{
    static readonly GameObject Owner = new GameObject();
    static readonly Queue<string> Told = new Queue<string>();
    static Puppet puppet;
    static TakeControls takeControls;
    static readonly Transform RootNode = new Transform { name = "puppetline_root" };
    static SkinnedMeshRenderer skin;
    static Mesh mesh;
    static int warned;
    static ulong sequenceBefore;
    static string leaveOn = "";

    /// <summary>Bones of the driven skeleton, for mode Bones.</summary>
    static List<Transform> bones = new List<Transform>();

    /// <summary>Attachments by vertex, handle or limb.</summary>
    static readonly List<PuppetAttachment> Attachments = new List<PuppetAttachment>();

    static int Main(string[] arguments)
    {
        Said.Open();
        puppet = Owner.AddComponent<Puppet>();
        skin = Owner.AddComponent<SkinnedMeshRenderer>();
        skin.sharedMesh = new Mesh { blendShapes = new[] { "smile", "motion_0", "motion_1", "motion_2" } };
        RootNode.localPosition = new Vector3(1, 2, 3);
        RootNode.localScale = new Vector3(2, 2, 2);
        RootNode.localRotation = Quaternion.Euler(0, 90, 0);
        var above = new Transform { name = "Scene" };
        above.SetParent(Owner.transform);
        RootNode.SetParent(above);
        foreach (string argument in arguments)
        {
            string[] pair = argument.Split(new[] { '=' }, 2);
            Set(pair[0], pair[1]);
        }
        Listen();
        takeControls = Owner.AddComponent<TakeControls>();
        takeControls.puppet = puppet;
        Player.Call(takeControls, "OnEnable");
        Player.Enable(puppet, true);
        new Thread(Read) { IsBackground = true }.Start();
        while (Step())
        {
            Thread.Sleep(5);
        }
        if (puppet.enabled)
        {
            Player.Enable(puppet, false);
        }
        Complain();
        Said.Line("ended", (mesh == null || mesh.destroyed) && GraphicsBuffer.Alive == 0, "rest", new object[] { RootNode.localPosition.x, RootNode.localPosition.y }, "weights", Weights());
        Said.End(0);
        return 0;
    }

    static void Set(string name, string value)
    {
        if (name == "pipeline")
        {
            GraphicsSettings.currentRenderPipeline = value == "Universal" ? new UniversalRenderPipelineAsset()
                : value == "HD" ? new HDRenderPipelineAsset()
                : new RenderPipelineAsset { material = Named(value) };
        }
        else if (name == "api")
        {
            SystemInfo.graphicsDeviceType = (GraphicsDeviceType)Enum.Parse(typeof(GraphicsDeviceType), value);
        }
        else if (name == "materials")
        {
            puppet.materials = Array.ConvertAll(value.Split(','), Named);
        }
        else if (name == "whole")
        {
            skin.sharedMesh.wholeBlendShape = float.Parse(value);
        }
        else if (name == "skins")
        {
            SkinnedMeshRenderer empty = Owner.AddComponent<SkinnedMeshRenderer>();
            puppet.rootNode = value == "found" ? null : RootNode;
            puppet.skins = value == "found" ? new SkinnedMeshRenderer[0] : new[] { null, empty, skin };
        }
        else if (name == "attach")
        {
            Array.ForEach(value.Split(','), Attach);
        }
        else if (name == "bones")
        {
            puppet.skeleton = new Transform { name = "Armature" };
            bones = Skeletons.Make(puppet.skeleton, Json.Parse(System.IO.File.ReadAllText(value)));
        }
        else if (name == "boneMap")
        {
            puppet.boneMap = new[] { new BoneName { joint = value, bone = "nobody" } };
        }
        else if (name == "scale")
        {
            string[] scale = value.Split(',');
            Owner.transform.lossyScale = new Vector3(float.Parse(scale[0]), float.Parse(scale[1]), float.Parse(scale[2]));
            Owner.transform.rotation = Quaternion.Euler(30, -50, 70);
            Owner.transform.position = new Vector3(3, -1, 2);
        }
        else if (name == "leaveOn")
        {
            leaveOn = value;
        }
        else if (name == "shapes")
        {
            skin.sharedMesh.blendShapes = value.Split(',');
        }
        else
        {
            FieldInfo field = typeof(Puppet).GetField(name);
            field.SetValue(puppet, field.FieldType.IsEnum ? Enum.Parse(field.FieldType, value, true) : Convert.ChangeType(value, field.FieldType, System.Globalization.CultureInfo.InvariantCulture));
        }
    }

    /// <summary>Attach an object to "vertex:5", "handle:hump" or "limb:left arm:0.5".</summary>
    static void Attach(string point)
    {
        string[] words = point.Split(':');
        PuppetAttachment made = new GameObject().AddComponent<PuppetAttachment>();
        made.puppet = puppet;
        made.vertex = words[0] == "vertex" ? int.Parse(words[1]) : -1;
        made.handle = words[0] == "handle" ? words[1] : "";
        made.limb = words[0] == "limb" ? words[1] : "";
        made.limbPosition = words.Length > 2 ? float.Parse(words[2], System.Globalization.CultureInfo.InvariantCulture) : 1;
        Attachments.Add(made);
    }

    static object[] PoseOf(PuppetAttachment attachment)
    {
        Player.Call(attachment, "LateUpdate");
        var numbers = new List<object>();
        Transform at = attachment.transform;
        foreach (Vector3 v in new[] { at.rotation * Vector3.right, at.rotation * Vector3.up, at.rotation * Vector3.forward, at.position })
        {
            numbers.Add(v.x);
            numbers.Add(v.y);
            numbers.Add(v.z);
        }
        return numbers.ToArray();
    }

    static object[] Space()
    {
        var numbers = new List<object>();
        Transform at = puppet.transform;
        foreach (Vector3 v in new[] { at.TransformVector(Vector3.right), at.TransformVector(Vector3.up), at.TransformVector(Vector3.forward), at.position })
        {
            numbers.Add(v.x);
            numbers.Add(v.y);
            numbers.Add(v.z);
        }
        return numbers.ToArray();
    }

    static Material Named(string shader)
    {
        return new Material(new Shader { name = shader }) { name = shader };
    }

    static void Listen()
    {
        PuppetEvents events = puppet.events;
        events.connected.AddListener(() => Said.Line("event", "connected"));
        events.disconnected.AddListener(() => Said.Line("event", "disconnected"));
        events.refused.AddListener(reason => Said.Line("event", "refused", "value", reason));
        events.sceneLoaded.AddListener(SayMesh);
        events.performerFound.AddListener(user => Said.Line("event", "performerFound", "value", user));
        events.performerCalibrated.AddListener(user => Said.Line("event", "performerCalibrated", "value", user));
        events.performerLost.AddListener(user => Said.Line("event", "performerLost", "value", user));
        events.takeStarted.AddListener(take => Said.Line("event", "takeStarted", "value", take));
        events.takeStopped.AddListener(take => Said.Line("event", "takeStopped", "value", take));
        events.connected.AddListener(() => Leave("connected"));
        events.disconnected.AddListener(() => Leave("disconnected"));
        events.sceneLoaded.AddListener(() => Leave("sceneLoaded"));
        events.performerFound.AddListener(user => Leave("performerFound"));
    }

    /// <summary>Disable the component inside an event, as a game that goes back to its menu does.</summary>
    static void Leave(string name)
    {
        if (name == leaveOn && puppet.enabled)
        {
            Player.Enable(puppet, false);
            Said.Line("left", name);
        }
    }

    static void Read()
    {
        for (string line = ""; line != null; line = Console.In.ReadLine())
        {
            lock (Told)
            {
                Told.Enqueue(line);
            }
        }
        lock (Told)
        {
            Told.Enqueue("end");
        }
    }

    static bool Step()
    {
        string[] told = new[] { "" };
        lock (Told)
        {
            told = Told.Count > 0 ? Told.Dequeue().Split(' ') : told;
        }
        switch (told[0])
        {
            case "calibrate":
                puppet.Calibrate();
                break;
            case "mirror":
                puppet.SetMirror(told[1] == "on");
                break;
            case "record":
                puppet.StartRecording(told.Length > 1 ? told[1] : null);
                break;
            case "stop":
                puppet.StopRecording();
                break;
            case "ask":
                puppet.Request(told[1], null, reply => Said.Line("reply", reply));
                break;
            case "set":
                Set(told[1], told[2]);
                puppet.Reconnect();
                break;
            case "tick":
                Time.deltaTime = Number(told[1]);
                Player.Call(puppet, "Update");
                Time.deltaTime = 0;
                Said.Line("at", puppet.Shown == null ? -1 : puppet.Shown.Header.Time);
                Complain();
                return true;
            case "advance":
                puppet.Advance(Number(told[1]));
                Said.Line("at", puppet.Shown == null ? -1 : puppet.Shown.Header.Time);
                Complain();
                return true;
            case "scale":
                Time.timeScale = Number(told[1]);
                break;
            case "capture":
                Time.captureDeltaTime = Number(told[1]);
                return true;
            case "change":
                Set(told[1], told[2]);
                break;
            case "press":
                GUILayout.pressed = string.Join(" ", told, 1, told.Length - 1);
                Player.Call(takeControls, "OnGUI");
                GUILayout.pressed = "";
                break;
            case "waiting":
                Said.Line("waiting", Waiting());
                break;
            case "disable":
                Player.Enable(puppet, false);
                break;
            case "end":
                return false;
        }
        if (!puppet.enabled || Time.captureDeltaTime > 0)
        {
            return true;
        }
        Frame before = puppet.Shown;
        ulong sequence = before == null ? 0 : before.Header.Sequence;
        double time = before == null ? 0 : before.Header.Time;
        Player.Call(puppet, "Update");
        Player.Call(takeControls, "Update");
        Complain();
        Frame shown = puppet.Shown;
        if (shown != null && (shown.Header.Sequence != sequence || shown.Header.Time != time))
        {
            SayShown();
            sequenceBefore = shown.Header.Sequence;
        }
        return true;
    }

    static void SayMesh()
    {
        if (!puppet.TryGetComponent(out MeshFilter filter))
        {
            Said.Line("event", "sceneLoaded");
            return;
        }
        puppet.TryGetComponent(out MeshRenderer renderer);
        mesh = filter.sharedMesh;
        Said.Line(
            "event", "sceneLoaded", "onGraphicsCard", puppet.OnGraphicsCard, "shown", renderer.enabled,
            "layout", Array.ConvertAll(mesh.layout, each => (object)(each.stream + " " + each.attribute + " " + each.dimension)),
            "indices", Said.Bytes(mesh.indices), "still", Said.Bytes(mesh.streams[1]), "ladder", Said.Bytes(mesh.streams[2]),
            "parts", Array.ConvertAll(mesh.subMeshes.ToArray(), part => (object)new object[] { part.indexStart, part.indexCount, part.firstVertex, part.vertexCount }),
            "atRest", Array.ConvertAll(mesh.subMeshes.ToArray(), part => (object)Numbers(part.bounds)),
            "materials", Array.ConvertAll(renderer.sharedMaterials, each => (object)each.shader.name),
            "colors", Array.ConvertAll(renderer.sharedMaterials, ColorOf));
    }

    static object[] Numbers(Bounds bounds)
    {
        Vector3 center = bounds.center, size = bounds.size;
        return new object[] { center.x, center.y, center.z, size.x, size.y, size.z };
    }

    static object ColorOf(Material material)
    {
        return material.properties.TryGetValue("_BaseColor", out object color)
            ? new object[] { ((Color)color).r, ((Color)color).g, ((Color)color).b }
            : null;
    }

    static object[] Weights()
    {
        var weights = new List<object>();
        foreach (KeyValuePair<int, float> pair in skin.weights)
        {
            weights.Add(new object[] { pair.Key, pair.Value });
        }
        return weights.ToArray();
    }

    static void SayShown()
    {
        Header header = puppet.Shown.Header;
        if (puppet.mode == PuppetMode.Morphs)
        {
            Vector3 at = RootNode.localPosition;
            Said.Line("frame", header.Sequence, "weights", Weights(), "root", new object[] { at.x, at.y, at.z });
            return;
        }
        if (puppet.mode == PuppetMode.Bones)
        {
            Player.Call(puppet, "LateUpdate");
            Said.Line("frame", header.Sequence, "time", header.Time, "weights", Weights(), "bones", Skeletons.PosesOf(puppet.skeleton, bones));
            return;
        }
        puppet.TryGetComponent(out MeshRenderer renderer);
        Said.Line(
            "frame", header.Sequence, "framesBefore", sequenceBefore, "time", header.Time, "moving", Said.Bytes(mesh.streams[0]), "rows", Rows(),
            "bounds", Numbers(mesh.bounds),
            "space", Space(), "attached", Attachments.ConvertAll(each => (object)PoseOf(each)).ToArray(),
            "enabled", renderer.enabled, "uploads", mesh.uploads, "uploaded", mesh.uploadedBytes);
    }

    static float Number(string text) => float.Parse(text, System.Globalization.CultureInfo.InvariantCulture);

    /// <summary>Number of frames that wait to be shown.</summary>
    static int Waiting()
    {
        const BindingFlags Own = BindingFlags.Instance | BindingFlags.NonPublic;
        object buffer = typeof(Puppet).GetField("buffer", Own).GetValue(puppet);
        return ((List<Frame>)typeof(FrameBuffer).GetProperty("Frames", Own).GetValue(buffer)).Count;
    }

    /// <summary>What the shader reads: a buffer or a texture.</summary>
    static string Rows()
    {
        Shader.Globals.TryGetValue(Shader.PropertyToID("_PuppetlineTransforms"), out object buffer);
        Shader.Globals.TryGetValue(Shader.PropertyToID("_PuppetlineTexture"), out object texture);
        return Said.Bytes(((GraphicsBuffer)buffer)?.contents ?? ((Texture2D)texture)?.contents);
    }

    static void Complain()
    {
        for (; warned < Debug.Warnings.Count; warned++)
        {
            Said.Line("warning", Debug.Warnings[warned]);
        }
    }
}

/// <summary>Named as the pipelines' own classes, by which the package knows them.</summary>
sealed class UniversalRenderPipelineAsset : RenderPipelineAsset
{
}

sealed class HDRenderPipelineAsset : RenderPipelineAsset
{
}
