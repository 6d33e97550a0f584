// The passes of the Universal Render Pipeline. A pass defines PUPPETLINE_PASS before it includes this file.

#ifndef PUPPETLINE_UNIVERSAL_INCLUDED
#define PUPPETLINE_UNIVERSAL_INCLUDED

#define PUPPETLINE_FORWARD 0
#define PUPPETLINE_SHADOW 1
#define PUPPETLINE_DEPTH 2
#define PUPPETLINE_DEPTH_NORMALS 3
#define PUPPETLINE_MOTION 4

#include "Packages/com.unity.render-pipelines.universal/ShaderLibrary/Core.hlsl"
#include "Packages/com.unity.render-pipelines.universal/ShaderLibrary/Lighting.hlsl"
#include "PuppetlineSurface.hlsl"
#include "Puppetline.hlsl"

#if PUPPETLINE_PASS == PUPPETLINE_SHADOW
#include "Packages/com.unity.render-pipelines.universal/ShaderLibrary/Shadows.hlsl"

// URP sets these while it draws a shadow map.
float3 _LightDirection;
float3 _LightPosition;
#endif

struct PuppetlineInputs
{
    PUPPETLINE_INPUTS
    UNITY_VERTEX_INPUT_INSTANCE_ID
};

struct PuppetlineVaryings
{
    float4 positionCS : SV_POSITION;
    float4 color : COLOR;
    float2 uv : TEXCOORD0;
    float3 positionWS : TEXCOORD1;
    float3 normalWS : TEXCOORD2;
#if PUPPETLINE_PASS == PUPPETLINE_FORWARD
    float4 lightAndFog : TEXCOORD3; // light of the vertex, and fog
#endif
#if PUPPETLINE_PASS == PUPPETLINE_MOTION
    float4 now : TEXCOORD4;
    float4 before : TEXCOORD5;
#endif
    UNITY_VERTEX_INPUT_INSTANCE_ID
    UNITY_VERTEX_OUTPUT_STEREO
};

#if PUPPETLINE_PASS == PUPPETLINE_SHADOW
// The clip-space position in a shadow map, with the light's bias.
float4 PuppetlineShadowPosition(float3 positionWS, float3 normalWS)
{
#if defined(_CASTING_PUNCTUAL_LIGHT_SHADOW)
    float3 toLight = normalize(_LightPosition - positionWS);
#else
    float3 toLight = _LightDirection;
#endif
    float4 positionCS = TransformWorldToHClip(ApplyShadowBias(positionWS, normalWS, toLight));
    // Casters in front of the near plane are moved onto it.
#if UNITY_REVERSED_Z
    positionCS.z = min(positionCS.z, UNITY_NEAR_CLIP_VALUE * positionCS.w);
#else
    positionCS.z = max(positionCS.z, UNITY_NEAR_CLIP_VALUE * positionCS.w);
#endif
    return positionCS;
}
#endif

PuppetlineVaryings PuppetlineVertex(PuppetlineInputs input)
{
    PuppetlineVaryings output = (PuppetlineVaryings)0;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_TRANSFER_INSTANCE_ID(input, output);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    PuppetlineRest rest;
    PUPPETLINE_REST(rest, input)
    PuppetlinePoint shown = PuppetlineShown(rest);
    output.color = input.color;
    output.uv = PuppetlineTexturePlace(input.uv);
    output.positionWS = TransformObjectToWorld(shown.position);
    output.normalWS = TransformObjectToWorldNormal(shown.normal);
#if PUPPETLINE_PASS == PUPPETLINE_SHADOW
    output.positionCS = PuppetlineShadowPosition(output.positionWS, output.normalWS);
#else
    output.positionCS = TransformWorldToHClip(output.positionWS);
#endif
#if PUPPETLINE_PASS == PUPPETLINE_FORWARD
    output.lightAndFog = float4(VertexLighting(output.positionWS, output.normalWS), ComputeFogFactor(output.positionCS.z));
#endif
#if PUPPETLINE_PASS == PUPPETLINE_MOTION
    output.now = mul(_NonJitteredViewProjMatrix, float4(output.positionWS, 1));
    output.before = mul(_PrevViewProjMatrix, mul(UNITY_PREV_MATRIX_M, float4(PuppetlinePositionBefore(rest), 1)));
#endif
    return output;
}

#if PUPPETLINE_PASS == PUPPETLINE_FORWARD
half4 PuppetlineFragment(PuppetlineVaryings input, bool front : SV_IsFrontFace) : SV_Target
{
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float4 base = PuppetlineBase(input.uv, input.color);
    SurfaceData surface = (SurfaceData)0;
    surface.albedo = base.rgb;
    surface.alpha = base.a;
    surface.metallic = _Metallic;
    surface.smoothness = _Smoothness;
    surface.emission = PuppetlineEmission(input.uv);
    surface.normalTS = half3(0, 0, 1);
    surface.occlusion = 1;
    InputData lighting = (InputData)0;
    lighting.positionWS = input.positionWS;
    lighting.normalWS = NormalizeNormalPerPixel(front ? input.normalWS : -input.normalWS);
    lighting.viewDirectionWS = GetWorldSpaceNormalizeViewDir(input.positionWS);
    lighting.fogCoord = input.lightAndFog.w;
    lighting.vertexLighting = input.lightAndFog.xyz;
    lighting.bakedGI = SampleSH(lighting.normalWS);
    lighting.normalizedScreenSpaceUV = GetNormalizedScreenSpaceUV(input.positionCS);
#if defined(_MAIN_LIGHT_SHADOWS_SCREEN) && !defined(_SURFACE_TYPE_TRANSPARENT)
    // URP has computed the shadows of opaque surfaces for the screen.
    lighting.shadowCoord = float4(lighting.normalizedScreenSpaceUV, 0, 1);
#else
    lighting.shadowCoord = TransformWorldToShadowCoord(input.positionWS);
#endif
    lighting.shadowMask = half4(1, 1, 1, 1);
    half4 color = UniversalFragmentPBR(lighting, surface);
    color.rgb = MixFog(color.rgb, lighting.fogCoord);
    return color;
}
#elif PUPPETLINE_PASS == PUPPETLINE_DEPTH_NORMALS
half4 PuppetlineFragment(PuppetlineVaryings input, bool front : SV_IsFrontFace) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    PuppetlineBase(input.uv, input.color);
    return half4(NormalizeNormalPerPixel(front ? input.normalWS : -input.normalWS), 0);
}
#elif PUPPETLINE_PASS == PUPPETLINE_MOTION
// Motion on the screen since the previous image, from 0 to 1 across the screen.
half4 PuppetlineFragment(PuppetlineVaryings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    PuppetlineBase(input.uv, input.color);
    float2 motion = input.now.xy / input.now.w - input.before.xy / input.before.w;
#if UNITY_UV_STARTS_AT_TOP
    motion.y = -motion.y;
#endif
    // Unity sets y to 0 for a renderer without motion.
    return unity_MotionVectorsParams.y == 0 ? half4(0, 0, 0, 0) : half4(0.5 * motion, 0, 0);
}
#else
half4 PuppetlineFragment(PuppetlineVaryings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    PuppetlineBase(input.uv, input.color);
    return half4(input.positionCS.z, 0, 0, 0);
}
#endif

#endif
