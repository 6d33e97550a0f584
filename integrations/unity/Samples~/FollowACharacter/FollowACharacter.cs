using Puppetline;
using UnityEngine;

/// <summary>Shows the state of a puppet on the screen, and buttons that send requests to the service.</summary>
public sealed class FollowACharacter : MonoBehaviour
{
    /// <summary>The puppet whose state is shown.</summary>
    public Puppet puppet;

    string performer = "No performer. Step in front of the sensor and stand still for one second.";
    bool mirrored;

    void OnEnable()
    {
        puppet.events.performerFound.AddListener(Found);
        puppet.events.performerCalibrated.AddListener(Calibrated);
        puppet.events.performerLost.AddListener(Lost);
    }

    void OnDisable()
    {
        puppet.events.performerFound.RemoveListener(Found);
        puppet.events.performerCalibrated.RemoveListener(Calibrated);
        puppet.events.performerLost.RemoveListener(Lost);
    }

    void OnGUI()
    {
        GUILayout.BeginArea(new Rect(10, 10, 400, 200));
        GUILayout.Label(puppet.State + " " + puppet.Reason);
        GUILayout.Label(performer);
        if (GUILayout.Button("Calibrate"))
        {
            puppet.Calibrate();
        }
        if (GUILayout.Button(mirrored ? "Do not mirror" : "Mirror"))
        {
            mirrored = !mirrored;
            puppet.SetMirror(mirrored);
        }
        GUILayout.EndArea();
    }

    void Found(int user)
    {
        performer = "Performer " + user + ": stand still for one second.";
    }

    void Calibrated(int user)
    {
        performer = "Performer " + user + " drives " + puppet.Character + ".";
    }

    void Lost(int user)
    {
        performer = "Performer " + user + " has left.";
    }
}
