// The properties of the shader Puppetline/Controls and the colours that they make, the same in every pipeline. The
// properties are in one constant buffer, so URP and HDRP can use the SRP Batcher.

#ifndef PUPPETLINE_SURFACE_INCLUDED
#define PUPPETLINE_SURFACE_INCLUDED

CBUFFER_START(UnityPerMaterial)
float4 _BaseMap_ST;
float4 _BaseColor;
float4 _EmissionColor;
float _Metallic;
float _Smoothness;
float _VertexColors;
float _Cutoff;
// HDRP reads these.
float _BlendMode;
float _EnableBlendModePreserveSpecularLighting;
float _RayTracing;
float4 _DoubleSidedConstants;
CBUFFER_END

Texture2D _BaseMap;
SamplerState sampler_BaseMap;
Texture2D _EmissionMap;
SamplerState sampler_EmissionMap;

// Base colour and alpha; discards what alpha clipping removes.
float4 PuppetlineBase(float2 uv, float4 color)
{
    float4 base = _BaseMap.Sample(sampler_BaseMap, uv) * _BaseColor;
    base.rgb *= lerp(float3(1, 1, 1), color.rgb, _VertexColors);
#if defined(_ALPHATEST_ON)
    clip(base.a - _Cutoff);
#endif
    return base;
}

float3 PuppetlineEmission(float2 uv)
{
    return _EmissionMap.Sample(sampler_EmissionMap, uv).rgb * _EmissionColor.rgb;
}

float2 PuppetlineTexturePlace(float2 uv)
{
    return uv * _BaseMap_ST.xy + _BaseMap_ST.zw;
}

#endif
