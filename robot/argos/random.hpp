/* SPDX-License-Identifier: MIT */
/*
 * random.hpp - ARGoS's random numbers: the same seed gives the same numbers in the same order as in
 * ARGoS, from the 32-bit Mersenne Twister (M. Matsumoto and T. Nishimura, "Mersenne Twister: a
 * 623-dimensionally equidistributed uniform pseudo-random number generator", ACM TOMACS 8(1), 1998,
 * seeded as in their mt19937ar of 2002).
 */
#ifndef VS_ARGOS_RANDOM_HPP
#define VS_ARGOS_RANDOM_HPP

#include "angles.hpp"

namespace argos {

class CRandom
{
public:
    class CRNG
    {
    public:
        explicit CRNG(UInt32 seed);
        virtual ~CRNG() {}

        UInt32 GetSeed() const { return m_seed; }
        /* Holds from the next Reset on. */
        void SetSeed(UInt32 seed) { m_seed = seed; }
        void Reset();

        bool Bernoulli(Real probability = 0.5);
        CRadians Uniform(const CRange<CRadians> &range);
        Real Uniform(const CRange<Real> &range);
        SInt32 Uniform(const CRange<SInt32> &range);
        UInt32 Uniform(const CRange<UInt32> &range);
        Real Exponential(Real mean);
        UInt32 Poisson(Real mean);
        Real Gaussian(Real std_dev, Real mean = 0.0);
        Real Rayleigh(Real sigma);
        Real Lognormal(Real sigma, Real mu);

        template <typename T> void Shuffle(std::vector<T> &values)
        {
            for (UInt32 i = 0; i + 1 < values.size(); ++i) {
                const UInt32 left = static_cast<UInt32>(values.size()) - i;
                std::swap(values[i], values[i + Uniform(CRange<UInt32>(0, left))]);
            }
        }

    private:
        static const UInt32 WORDS = 624;

        template <typename T> T Draw(const CRange<T> &range);
        UInt32 Next();
        void Twist();

        UInt32 m_seed;
        UInt32 m_state[WORDS];
        UInt32 m_used;
    };

    /* Generators that are seeded one after the other from one seed. */
    class CCategory
    {
    public:
        CCategory(const std::string &id, UInt32 seed);
        virtual ~CCategory();
        CCategory(const CCategory &) = delete;
        CCategory &operator=(const CCategory &) = delete;

        const std::string &GetId() const { return m_id; }
        void SetId(const std::string &id) { m_id = id; }
        UInt32 GetSeed() const { return m_seeder.GetSeed(); }
        /* Holds from the next ResetRNGs on. */
        void SetSeed(UInt32 seed) { m_seeder.SetSeed(seed); }
        /* The category owns it. */
        CRNG *CreateRNG();
        void ResetRNGs();
        void ReseedRNGs();
        /* Ours: the next generator made is the first one of this seed; those there are stay. */
        void VsRestart(UInt32 seed);

    private:
        UInt32 NextSeed();

        std::string m_id;
        CRNG m_seeder;
        std::vector<CRNG *> m_made;
    };

    /* False: there is one of this name. */
    static bool CreateCategory(const std::string &category, UInt32 seed);
    static CCategory &GetCategory(const std::string &category);
    static bool ExistsCategory(const std::string &category);
    static void RemoveCategory(const std::string &category);
    static CRNG *CreateRNG(const std::string &category);
    static UInt32 GetSeedOf(const std::string &category);
    static void SetSeedOf(const std::string &category, UInt32 seed);
    static void Reset();
};

}  // namespace argos

#endif
