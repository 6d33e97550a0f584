using System.IO;
using UnityEditor.AssetImporters;

namespace Puppetline.Editing
{
    /// <summary>Imports .clip files of <c>puppetline clip</c> as <see cref="PuppetClip"/>.</summary>
    [ScriptedImporter(1, "clip")]
    public sealed class PuppetClipImporter : ScriptedImporter
    {
        /// <inheritdoc/>
        public override void OnImportAsset(AssetImportContext ctx)
        {
            PuppetClip clip = PuppetClip.Create(File.ReadAllBytes(ctx.assetPath));
            clip.name = Path.GetFileNameWithoutExtension(ctx.assetPath);
            if (clip.Clip == null)
            {
                ctx.LogImportError("Puppetline: " + clip.Problem);
            }
            ctx.AddObjectToAsset("clip", clip);
            ctx.SetMainObject(clip);
        }
    }
}
