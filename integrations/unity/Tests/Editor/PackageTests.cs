using NUnit.Framework;
using Puppetline.Protocol;
using UnityEditor;
using UnityEngine;

namespace Puppetline.Editing
{
    /// <summary>
    /// Tests of the package in the Test Runner of Unity. Add "com.puppetline.unity" to the testables of Packages/manifest.json.
    /// </summary>
    public sealed class PackageTests
    {
        const string ClipPath = "Packages/com.puppetline.unity/Tests/Editor/worm.clip";

        static Clip Worm => AssetDatabase.LoadAssetAtPath<PuppetClip>(ClipPath).Clip;

        /// <summary>The importer makes a clip of a .clip file.</summary>
        [Test]
        public void ClipFilesAreImported()
        {
            Assert.That(Worm, Is.Not.Null);
            Assert.That(Worm.Character, Is.EqualTo("worm"));
            Assert.That(Worm.FrameCount, Is.EqualTo(3));
            Assert.That(Worm.Scene.VertexCount, Is.EqualTo(162));
        }

        /// <summary>A pose between two frames is their mean.</summary>
        [Test]
        public void PosesBetweenFramesAreMixed()
        {
            var playback = new ClipPlayback(Worm);
            float first = playback.Evaluate(1.0 / 30).Values[3], second = playback.Evaluate(2.0 / 30).Values[3];
            Assert.That(playback.Evaluate(1.5 / 30).Values[3], Is.EqualTo((first + second) / 2).Within(1e-5));
        }

        /// <summary>The shader has no errors, and supports the project's pipeline and this graphics card.</summary>
        [Test]
        public void TheShaderIsSupported()
        {
            var shader = Resources.Load<Shader>("PuppetlineControls");
            Assert.That(shader, Is.Not.Null);
            Assert.That(ShaderUtil.ShaderHasError(shader), Is.False);
            Assert.That(shader.isSupported, Is.True);
        }
    }
}
