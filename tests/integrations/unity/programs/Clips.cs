using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using Puppetline;
using Puppetline.Protocol;
using UnityEngine;
using UnityEngine.Playables;

/// <summary>
/// Plays clips in a stand-in for Unity. Arguments: two files, then steps: "at:SECONDS", "blend:SECONDS:SECONDS:WEIGHT",
/// "timeline:SECONDS:WEIGHT:SECONDS:WEIGHT", "play:SECONDS" for one update of that length, "speed:S", "once", "clock:NAME",
/// "advance:SECONDS", "editing" for the editor outside of play mode, "swap", which plays the second clip, "attach:VERTEX",
/// which shows where an attached object is, and "materials", which shows those that the package makes.
/// </summary>
static class Clips
{
    static readonly Puppet Shower = new GameObject().AddComponent<Puppet>();
    static readonly PuppetAttachment Attached = new GameObject().AddComponent<PuppetAttachment>();
    static PuppetClip first, other;
    static int warned;

    static void Main(string[] arguments)
    {
        Said.Open();
        first = PuppetClip.Create(File.ReadAllBytes(arguments[0]));
        first.name = "first";
        Shower.clip = first;
        other = PuppetClip.Create(File.ReadAllBytes(arguments[1]));
        other.name = "second";
        bool plain = Array.IndexOf(arguments, "materials") >= 0;
        Shower.materials = plain ? new Material[0] : new[] { new Material(new Shader { name = "Any/Shader" }) };
        Shower.events.sceneLoaded.AddListener(() => Said.Line("loaded", Shower.Character));
        Player.Enable(Shower, true);
        for (int i = 2; i < arguments.Length; i++)
        {
            Do(arguments[i].Split(':'));
            Complain();
        }
        Complain();
        Player.Enable(Shower, false);
    }

    static void Do(string[] words)
    {
        switch (words[0])
        {
            case "at":
                Shower.clipSpeed = 0;
                Shower.clipPosition = Number(words[1]);
                Update(0);
                break;
            case "blend":
                Shower.ShowClips(Shower.clip, Number(words[1]), other, Number(words[2]), Number(words[3]));
                Say();
                break;
            case "editing":
                Application.isPlaying = false;
                break;
            case "timeline":
                ShowTimeline(words);
                Say();
                break;
            case "play":
                Update(Number(words[1]));
                break;
            case "speed":
                Shower.clipSpeed = Number(words[1]);
                break;
            case "once":
                Shower.clipLoops = false;
                break;
            case "clock":
                Shower.clock = (PuppetClock)Enum.Parse(typeof(PuppetClock), words[1]);
                break;
            case "advance":
                Shower.Advance(Number(words[1]));
                Say();
                break;
            case "attach":
                Attached.puppet = Shower;
                Attached.vertex = int.Parse(words[1]);
                Player.Call(Attached, "LateUpdate");
                Vector3 place = Attached.transform.position;
                Said.Line("attached", new object[] { place.x, place.y, place.z });
                break;
            case "materials":
                Update(0);
                SayMaterials();
                break;
            case "swap":
                Shower.clip = other;
                break;
        }
    }

    /// <summary>"timeline:SECONDS:WEIGHT:SECONDS:WEIGHT": show the two clips as inputs of a track at these times.</summary>
    static void ShowTimeline(string[] words)
    {
        var track = new PuppetClipTrack();
        Playable mixer = track.CreateTrackMixer(default, null, 2);
        for (int i = 0; i < 2; i++)
        {
            var asset = new PuppetClipPlayableAsset { clip = i == 0 ? first : other };
            Playable input = asset.CreatePlayable(default, null);
            input.node.time = Number(words[1 + 2 * i]);
            mixer.node.inputs.Add(input);
            mixer.node.weights.Add(Number(words[2 + 2 * i]));
            Said.Line("duration", asset.duration);
        }
        mixer.node.behaviour.ProcessFrame(mixer, default, Shower);
    }

    static void SayMaterials()
    {
        Shower.TryGetComponent(out MeshRenderer renderer);
        foreach (Material material in renderer.sharedMaterials)
        {
            var told = new List<object> { "queue", material.renderQueue, "keywords", string.Join(" ", material.keywords) };
            foreach (KeyValuePair<string, object> each in material.properties)
            {
                told.Add(each.Key);
                told.Add(each.Value is Color color ? new object[] { color.r, color.g, color.b, color.a } : each.Value);
            }
            Said.Line(told.ToArray());
        }
    }

    static void Update(float seconds)
    {
        Time.deltaTime = seconds;
        Player.Call(Shower, "Update");
        Say();
    }

    static void Say()
    {
        Frame shown = Shower.Shown;
        Shower.TryGetComponent(out MeshFilter filter);
        object root = shown == null ? null : new object[] { shown.Header.RootX, shown.Header.RootY, shown.Header.RootZ };
        Said.Line(
            "position", Shower.clipPosition, "time", shown == null ? -1 : shown.Header.Time, "root", root,
            "vertices", filter == null ? "" : Said.Bytes(filter.sharedMesh.streams[0]));
    }

    static void Complain()
    {
        for (; warned < Debug.Warnings.Count; warned++)
        {
            Said.Line("warning", Debug.Warnings[warned]);
        }
    }

    static float Number(string text) => float.Parse(text, CultureInfo.InvariantCulture);
}
