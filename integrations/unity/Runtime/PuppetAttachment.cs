using System;
using Puppetline.Protocol;
using UnityEngine;

namespace Puppetline
{
    /// <summary>
    /// Moves this object with a point of a <see cref="Puppet"/>, for hats, props, lights and sounds. Its y axis points out of
    /// the surface or along the limb, and its z axis to the front of the character at rest. The object is never scaled.
    /// </summary>
    [AddComponentMenu("Puppetline/Puppet Attachment")]
    [DisallowMultipleComponent]
    public sealed class PuppetAttachment : MonoBehaviour
    {
        /// <summary>The character to follow.</summary>
        [Tooltip("The character to follow.")]
        public Puppet puppet;

        /// <summary>Number of a vertex of the character's scene; −1 for none.</summary>
        [Tooltip("Number of a vertex of the character's scene; −1 for none.")]
        public int vertex = -1;

        /// <summary>Name of a handle, whose position on the surface is followed if there is no vertex.</summary>
        [Tooltip("Name of a handle, whose position on the surface is followed if there is no vertex.")]
        public string handle = "";

        /// <summary>Name of a limb, which is followed if there is neither a vertex nor a handle.</summary>
        [Tooltip("Name of a limb, which is followed if there is neither a vertex nor a handle.")]
        public string limb = "";

        /// <summary>Position along the limb: 0 at its root, 1 at its tip.</summary>
        [Tooltip("Position along the limb: 0 at its root, 1 at its tip.")]
        [Range(0, 1)]
        public float limbPosition = 1;

        /// <summary>Whether this object turns with the surface. If not, it has the rotation of the character.</summary>
        [Tooltip("Whether this object turns with the surface. If not, it has the rotation of the character.")]
        public bool followRotation = true;

        /// <summary>Position relative to the point, in its axes.</summary>
        [Tooltip("Position relative to the point, in its axes.")]
        public Vector3 offset;

        /// <summary>Rotation relative to the point, in degrees.</summary>
        [Tooltip("Rotation relative to the point, in degrees.")]
        public Vector3 turn;

        SurfacePatch patch;
        Scene patchScene;
        ValueTuple<int, string, string, float> patchPoint;

        /// <summary>Whether the character has the point.</summary>
        public bool IsAttached => patch != null;

        void LateUpdate()
        {
            if (puppet == null || puppet.Scene == null)
            {
                return;
            }
            FindPoint();
            if (patch != null && puppet.TryGetPose(patch, out Vector3 position, out Quaternion rotation))
            {
                rotation = (followRotation ? rotation : puppet.transform.rotation) * Quaternion.Euler(turn.x, turn.y, turn.z);
                transform.SetPositionAndRotation(position + rotation * offset, rotation);
            }
        }

        /// <summary>Find the point, if the scene or the fields have changed.</summary>
        void FindPoint()
        {
            var point = ValueTuple.Create(vertex, handle, limb, limbPosition);
            if (patchScene == puppet.Scene && point.Equals(patchPoint))
            {
                return;
            }
            patchScene = puppet.Scene;
            patchPoint = point;
            patch = Find(patchScene);
            if (patch == null)
            {
                Debug.LogWarning("Puppetline: the character has no such point. Set vertex, handle or limb.", this);
            }
        }

        SurfacePatch Find(Scene scene)
        {
            if (vertex >= 0)
            {
                return vertex < scene.VertexCount ? SurfacePatch.AtVertex(scene, vertex) : null;
            }
            return handle.Length > 0 ? SurfacePatch.AtHandle(scene, handle) : SurfacePatch.InsideLimb(scene, limb, limbPosition);
        }
    }
}
