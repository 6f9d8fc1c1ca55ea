/* SPDX-License-Identifier: MIT */
/*
 * random.cpp - ARGoS's random numbers: see random.hpp. The order and the number of draws of every
 * distribution are ARGoS's (Source: src/core/utility/math/rng.cpp at 421bd76), since another order
 * would be another run.
 */
#include "random.hpp"

namespace argos {

namespace {

const UInt32 MIDDLE = 397;
const UInt32 TWIST = 0x9908b0df;
const UInt32 HIGHEST_BIT = 0x80000000;
const UInt32 LARGEST = 0xffffffff;

const CRange<Real> UNIT(0.0, 1.0);
const CRange<Real> BOTH_WAYS(-1.0, 1.0);

/* All categories, made with the first of them: an object here might be made too late. */
std::vector<CRandom::CCategory *> &Categories()
{
    static std::vector<CRandom::CCategory *> *const categories =
        new std::vector<CRandom::CCategory *>;
    return *categories;
}

CRandom::CCategory *Find(const std::string &name)
{
    for (CRandom::CCategory *category : Categories())
        if (category->GetId() == name)
            return category;
    return nullptr;
}

}  // namespace

CRandom::CRNG::CRNG(UInt32 seed) : m_seed(seed)
{
    Reset();
}

void CRandom::CRNG::Reset()
{
    m_state[0] = m_seed;
    for (UInt32 i = 1; i < WORDS; ++i)
        m_state[i] = 1812433253u * (m_state[i - 1] ^ (m_state[i - 1] >> 30)) + i;
    m_used = WORDS;
}

/* The recurrence, over all words at once. */
void CRandom::CRNG::Twist()
{
    for (UInt32 i = 0; i < WORDS; ++i) {
        const UInt32 next = m_state[(i + 1) % WORDS];
        const UInt32 joined = (m_state[i] & HIGHEST_BIT) | (next & ~HIGHEST_BIT);
        m_state[i] = m_state[(i + MIDDLE) % WORDS] ^ (joined >> 1) ^ ((joined & 1) * TWIST);
    }
    m_used = 0;
}

UInt32 CRandom::CRNG::Next()
{
    if (m_used >= WORDS)
        Twist();
    UInt32 bits = m_state[m_used++];
    bits ^= bits >> 11;
    bits ^= (bits << 7) & 0x9d2c5680;
    bits ^= (bits << 15) & 0xefc60000;
    return bits ^ (bits >> 18);
}

template <typename T> T CRandom::CRNG::Draw(const CRange<T> &range)
{
    T value;
    CRange<UInt32>(0, LARGEST).MapValueIntoRange(value, Next(), range);
    return value;
}

bool CRandom::CRNG::Bernoulli(Real probability)
{
    return Next() < probability * LARGEST;
}

CRadians CRandom::CRNG::Uniform(const CRange<CRadians> &range)
{
    return Draw(range);
}

Real CRandom::CRNG::Uniform(const CRange<Real> &range)
{
    return Draw(range);
}

SInt32 CRandom::CRNG::Uniform(const CRange<SInt32> &range)
{
    return Draw(range);
}

UInt32 CRandom::CRNG::Uniform(const CRange<UInt32> &range)
{
    return Draw(range);
}

Real CRandom::CRNG::Exponential(Real mean)
{
    return -Log(Draw(UNIT)) * mean;
}

/* By inversion, along the cumulative sum. */
UInt32 CRandom::CRNG::Poisson(Real mean)
{
    UInt32 count = 0;
    Real term = Exp(-mean), sum = term;
    const Real drawn = Draw(UNIT);
    while (drawn > sum) {
        ++count;
        term *= mean / count;
        sum += term;
    }
    return count;
}

/* The polar method, of whose two numbers one is used. */
Real CRandom::CRNG::Gaussian(Real std_dev, Real mean)
{
    Real first, square;
    do {
        first = Draw(BOTH_WAYS);
        const Real second = Draw(BOTH_WAYS);
        square = first * first + second * second;
    } while (square >= 1.0);
    return mean + std_dev * first * Sqrt(-2.0 * Log(square) / square);
}

Real CRandom::CRNG::Rayleigh(Real sigma)
{
    Real drawn;
    do
        drawn = Draw(UNIT);
    while (drawn <= 0.0 || drawn >= 1.0);
    return sigma * Sqrt(-2.0 * Log(drawn));
}

Real CRandom::CRNG::Lognormal(Real sigma, Real mu)
{
    return Exp(mu + sigma * Gaussian(1.0, 0.0));
}

CRandom::CCategory::CCategory(const std::string &id, UInt32 seed) : m_id(id), m_seeder(seed) {}

CRandom::CCategory::~CCategory()
{
    for (CRNG *made : m_made)
        delete made;
}

UInt32 CRandom::CCategory::NextSeed()
{
    return m_seeder.Uniform(CRange<UInt32>(1, LARGEST));
}

CRandom::CRNG *CRandom::CCategory::CreateRNG()
{
    m_made.push_back(new CRNG(NextSeed()));
    return m_made.back();
}

void CRandom::CCategory::ResetRNGs()
{
    m_seeder.Reset();
    ReseedRNGs();
    for (CRNG *made : m_made)
        made->Reset();
}

void CRandom::CCategory::ReseedRNGs()
{
    for (CRNG *made : m_made)
        made->SetSeed(NextSeed());
}

void CRandom::CCategory::VsRestart(UInt32 seed)
{
    m_seeder.SetSeed(seed);
    m_seeder.Reset();
}

bool CRandom::CreateCategory(const std::string &category, UInt32 seed)
{
    if (Find(category) != nullptr)
        return false;
    Categories().push_back(new CCategory(category, seed));
    return true;
}

CRandom::CCategory &CRandom::GetCategory(const std::string &category)
{
    CCategory *found = Find(category);
    if (found == nullptr)
        THROW_ARGOSEXCEPTION("CRandom:: can't find category \"" << category << "\".");
    return *found;
}

bool CRandom::ExistsCategory(const std::string &category)
{
    return Find(category) != nullptr;
}

void CRandom::RemoveCategory(const std::string &category)
{
    CCategory *found = &GetCategory(category);
    std::vector<CCategory *> &all = Categories();
    all.erase(std::find(all.begin(), all.end(), found));
    delete found;
}

CRandom::CRNG *CRandom::CreateRNG(const std::string &category)
{
    return GetCategory(category).CreateRNG();
}

UInt32 CRandom::GetSeedOf(const std::string &category)
{
    return GetCategory(category).GetSeed();
}

void CRandom::SetSeedOf(const std::string &category, UInt32 seed)
{
    GetCategory(category).SetSeed(seed);
}

void CRandom::Reset()
{
    for (CCategory *category : Categories())
        category->ResetRNGs();
}

}  // namespace argos
