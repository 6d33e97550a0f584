using System.Collections.Generic;
using Puppetline;
using Puppetline.Protocol;
using UnityEngine;

/// <summary>Buttons that record takes of a puppet's performer, play them on its character, and trim what is played.</summary>
public sealed class TakeControls : MonoBehaviour
{
    /// <summary>The puppet whose performer is recorded, and whose character plays takes.</summary>
    public Puppet puppet;

    /// <summary>Count-in of a take that is recorded while others play, in seconds.</summary>
    public int countInSeconds = 3;

    readonly List<string> takes = new List<string>();
    Json status = Json.Null;
    string chosen = "", recording = "", problem = "";
    double position, first, last = double.PositiveInfinity;

    /// <summary>The service's timeline of the takes that play (docs/control.md); null without any.</summary>
    Json Timeline => puppet.Status["timeline"];

    bool Plays => Timeline["takes"].Count > 0;

    void OnEnable()
    {
        puppet.events.connected.AddListener(Ask);
        puppet.events.takeStarted.AddListener(Started);
        puppet.events.takeStopped.AddListener(Stopped);
    }

    void OnDisable()
    {
        puppet.events.connected.RemoveListener(Ask);
        puppet.events.takeStarted.RemoveListener(Started);
        puppet.events.takeStopped.RemoveListener(Stopped);
    }

    void Update()
    {
        if (puppet.Status != status)
        {
            status = puppet.Status;
            position = Timeline["position"].Number;
        }
        else if (Plays && !Timeline["paused"].True)
        {
            position += Time.deltaTime * Timeline["speed"].Number;
        }
    }

    void OnGUI()
    {
        GUILayout.BeginArea(new Rect(10, 220, 400, 400));
        GUILayout.Label(problem);
        if (recording.Length > 0 && GUILayout.Button("Stop " + recording))
        {
            puppet.StopRecording();
        }
        if (recording.Length == 0 && GUILayout.Button(Plays ? "Record over" : "Record"))
        {
            Record();
        }
        foreach (string take in takes)
        {
            if (GUILayout.Button("Play " + take))
            {
                chosen = take;
                first = 0;
                last = double.PositiveInfinity;
                Play();
            }
        }
        if (Plays)
        {
            ShowTimeline();
        }
        GUILayout.EndArea();
    }

    void ShowTimeline()
    {
        bool paused = Timeline["paused"].True;
        GUILayout.Label(position.ToString("0.0") + " of " + Timeline["end"].Number.ToString("0.0") + " s");
        if (GUILayout.Button(paused ? "Continue" : "Pause"))
        {
            Send("pause", "on", !paused);
        }
        if (chosen.Length > 0 && GUILayout.Button("Begin here"))
        {
            first = Second();
            Play();
        }
        if (chosen.Length > 0 && GUILayout.Button("End here"))
        {
            last = Second();
            Play();
        }
        if (GUILayout.Button("Play in a loop"))
        {
            Send("loop", "on", !Timeline["loop"].True);
        }
        if (GUILayout.Button("Back to the performer"))
        {
            puppet.Request("stop");
        }
    }

    /// <summary>Record the performer. Takes that play begin again after a count-in, and are recorded over.</summary>
    void Record()
    {
        var arguments = new Dictionary<string, object> { { "count_in", Plays ? countInSeconds : 0 } };
        if (puppet.Stage.Length > 0)
        {
            arguments["stage"] = puppet.Stage;
        }
        puppet.Request("record_start", arguments, Say);
    }

    /// <summary>Play the chosen part of the chosen take.</summary>
    void Play()
    {
        var arguments = new Dictionary<string, object> { { "character", puppet.Character }, { "take", chosen }, { "start", first } };
        if (last > first && !double.IsInfinity(last))
        {
            arguments["stop"] = last;
        }
        puppet.Request("play_take", arguments, Say);
    }

    /// <summary>Return the second of the chosen take that is shown.</summary>
    double Second()
    {
        Json playing = Timeline["takes"];
        double at = 0;
        for (int i = 0; i < playing.Count; i++)
        {
            at = playing[i]["take"].Text == chosen ? playing[i]["at"].Number : at;
        }
        return first + position - at;
    }

    void Send(string command, string name, object value)
    {
        puppet.Request(command, new Dictionary<string, object> { { name, value } }, Say);
    }

    void Ask()
    {
        puppet.Request("list", null, Listed);
    }

    void Listed(Json reply)
    {
        Say(reply);
        Json listed = reply["result"]["takes"];
        takes.Clear();
        for (int i = 0; i < listed.Count; i++)
        {
            takes.Add(listed[i]["name"].Text);
        }
    }

    void Started(string name)
    {
        recording = name;
    }

    void Stopped(string name)
    {
        recording = "";
        Ask();
    }

    void Say(Json reply)
    {
        Json error = reply["error"];
        problem = reply["ok"].True ? "" : "Found " + error["found"].Text + "; expected " + error["expected"].Text + ". " + error["fix"].Text;
    }
}
