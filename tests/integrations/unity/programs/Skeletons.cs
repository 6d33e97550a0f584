using System.Collections.Generic;
using Puppetline.Protocol;
using UnityEngine;

/// <summary>Skeletons of stand-ins, described by right-handed data of the tests.</summary>
static class Skeletons
{
    /// <summary>Make the bones below a root; each has a name, a parent, a rotation and a position.</summary>
    public static List<Transform> Make(Transform root, Json bones)
    {
        var made = new List<Transform>();
        for (int i = 0; i < bones.Count; i++)
        {
            Json turn = bones[i]["rotation"], place = bones[i]["position"];
            var bone = new Transform
            {
                name = bones[i]["name"].Text,
                localRotation = new Quaternion((float)turn[0].Number, -(float)turn[1].Number, -(float)turn[2].Number, (float)turn[3].Number),
                localPosition = new Vector3(-(float)place[0].Number, (float)place[1].Number, (float)place[2].Number),
            };
            bone.SetParent(bones[i]["parent"].Number < 0 ? root : made[(int)bones[i]["parent"].Number]);
            made.Add(bone);
        }
        return made;
    }

    /// <summary>Return the right-handed rotation and position of each bone relative to the root, seven numbers.</summary>
    public static object[] PosesOf(Transform root, List<Transform> bones)
    {
        return bones.ConvertAll(bone =>
        {
            Quaternion turn = Quaternion.identity;
            Vector3 place = Vector3.zero;
            for (Transform each = bone; each != root; each = each.parent)
            {
                place = each.localPosition + each.localRotation * Vector3.Scale(each.localScale, place);
                turn = each.localRotation * turn;
            }
            return (object)new object[] { turn.x, -turn.y, -turn.z, turn.w, -place.x, place.y, place.z };
        }).ToArray();
    }
}
