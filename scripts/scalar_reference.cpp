// A scalar program for the paper's two-mass chain, written for that purpose and nothing else: exact modal flow,
// proved steps, impacts, sticking. What the sweep of vijax is measured against.
// Arguments: s1 s2 A Omega0 Omega1 points transient record max_step print (2: the impact times).
#include <cstdio>
#include <cmath>
#include <cstdlib>
#include <vector>
#include <cstring>
#include <chrono>
#include <algorithm>
using namespace std;
struct Modal{int n;double W[2],Z[2],WD[2],PS[2][2],xs[2];double xr[2],xi[2];};
struct Par{double s[2],sg[2],r,A,c,k,Om;};
static void build(const Par&p,int mask,Modal&m){ memset(&m,0,sizeof m); double E[2][2]={{2,-1},{-1,1}}; 
  if(mask==0){m.n=2;double s5=sqrt(5.);double lam[2]={(3-s5)/2,(3+s5)/2};for(int j=0;j<2;j++){double a=1,b=2-lam[j],n=hypot(a,b);m.PS[0][j]=a/n;m.PS[1][j]=b/n;m.W[j]=sqrt(lam[j]*p.k);m.Z[j]=p.c*lam[j]/2;}}
  else if(mask<3){int f=mask==1?1:0;m.n=1;double lam=E[f][f];m.PS[f][0]=1;m.W[0]=sqrt(lam*p.k);m.Z[0]=p.c*lam/2;int q=1-f;m.xs[q]=p.s[q];m.xs[f]=p.s[q]/lam;}
  else {m.n=0;m.xs[0]=p.s[0];m.xs[1]=p.s[1];}
  for(int j=0;j<m.n;j++){m.WD[j]=sqrt(m.W[j]*m.W[j]-m.Z[j]*m.Z[j]);double fj=m.PS[0][j]*p.A,dr=m.W[j]*m.W[j]-p.Om*p.Om,di=2*m.Z[j]*p.Om,d=dr*dr+di*di;for(int i=0;i<2;i++){m.xr[i]+=m.PS[i][j]*fj*dr/d;m.xi[i]-=m.PS[i][j]*fj*di/d;}}
}
long NIT=0,NEV=0,NST=0,NREL=0;
struct St{double x[2],v[2],th;int mask;};
static inline void force(const Par&p,const double*x,const double*v,double co,double*f){f[0]=-p.k*(2*x[0]-x[1])-p.c*(2*v[0]-v[1])+p.A*co;f[1]=-p.k*(x[1]-x[0])-p.c*(v[1]-v[0]);}

// largest safe step for lower polynomial, kind: 0 open,1 just impacted,2 released by jump,3 released by force crossing
static inline double safe(int kind,double g,double gd,double gdd,double g3,double B4,double Umax){
  double best=0,U=Umax;
  if(kind==3){ double u=4*max(g3,0.0)/(B4+1e-300); return min(max(u,1e-5),Umax);} 
  if(kind==2){ for(int it=0;it<3;it++){double K=max(1e-300,-g3/3+B4*U/12);double u=max(gdd,0.0)/K;best=max(best,min(u,U)); if(u>=U)break; U=(u+U)/2;} return max(best,1e-5);} 
  if(kind==1) g=0;
  double lo=0,hi=Umax;
  for(int it=0;it<5;it++){ double K=max(0.0,-gdd+max(0.0,-g3)*U/3+B4*U*U/12); double disc=sqrt(gd*gd+2*K*g); double u = gd<0 ? 2*g/(disc-gd+1e-300) : (gd+disc)/(K+1e-300); double f=min(u,U); if(f>best)best=f; if(u>=U){ if(it==0) return U; lo=U; } else hi=U; U= (u>lo&&u<hi&&it==0)? min(u*1.5,hi) : 0.5*(max(best,lo)+hi); }
  return best; }
template<class F> void adv(const Par&p,const Modal*M,St&s,double T,double gtol,double vst,double Umax,F cb,int*just){ double t=0; long guard=0;
  while(t<T){ if(++guard>300000){fprintf(stderr,"guard Om=%g mask %d x %g %g v %g %g t %g/%g just %d %d\n",p.Om,s.mask,s.x[0],s.x[1],s.v[0],s.v[1],t,T,just[0],just[1]);return;} NIT++; const Modal&m=M[s.mask]; double co=cos(s.th),si=sin(s.th); double B[2],C[2],amp[2]; double y[2],w[2]; for(int i=0;i<2;i++){y[i]=s.x[i]-m.xs[i]-(m.xr[i]*co-m.xi[i]*si);w[i]=s.v[i]+p.Om*(m.xr[i]*si+m.xi[i]*co);} 
    for(int j=0;j<m.n;j++){B[j]=m.PS[0][j]*y[0]+m.PS[1][j]*y[1];double qd=m.PS[0][j]*w[0]+m.PS[1][j]*w[1];C[j]=(qd+m.Z[j]*B[j])/m.WD[j];amp[j]=sqrt(B[j]*B[j]+C[j]*C[j]);}
    double f[2];force(p,s.x,s.v,co,f); double a[2]={f[0],f[1]};for(int i=0;i<2;i++)if(s.mask>>i&1)a[i]=0;
    double fd[2]; force(p,s.v,a,0,fd); fd[0]-=p.A*p.Om*si; double jk[2]={fd[0],fd[1]};for(int i=0;i<2;i++)if(s.mask>>i&1)jk[i]=0;
    double D2[2],D3[2],D4[2];for(int i=0;i<2;i++){double fa=hypot(m.xr[i],m.xi[i]);D2[i]=p.Om*p.Om*fa;D3[i]=p.Om*D2[i];D4[i]=p.Om*D3[i];for(int j=0;j<m.n;j++){double q=fabs(m.PS[i][j])*m.W[j]*m.W[j]*amp[j];D2[i]+=q;q*=m.W[j];D3[i]+=q;D4[i]+=q*m.W[j];}}
    double tau=min(T-t,Umax);
    for(int i=0;i<2;i++){ double sg=p.sg[i]; if(!(s.mask>>i&1)){double g=max(0.0,sg*(p.s[i]-s.x[i])); tau=min(tau,safe(just[i],g,-sg*s.v[i],-sg*a[i],-sg*jk[i],D4[i],Umax));}
      else {double lam=max(0.0,sg*f[i]);double ld=sg*fd[i],lb; if(i==0)lb=p.k*D2[1]+p.c*D3[1]+p.A*p.Om*p.Om;else lb=p.k*D2[0]+p.c*D3[0]; double disc=sqrt(ld*ld+2*lb*lam);double u=ld<0?2*lam/(disc-ld+1e-300):(ld+disc)/(lb+1e-300); tau=min(tau,u+1e-13);} }
    s.th+=p.Om*tau;t+=tau;co=cos(s.th);si=sin(s.th); double X[2],V[2];for(int i=0;i<2;i++){X[i]=m.xs[i]+m.xr[i]*co-m.xi[i]*si;V[i]=-p.Om*(m.xr[i]*si+m.xi[i]*co);}
    for(int j=0;j<m.n;j++){double e=exp(-m.Z[j]*tau),cj=e*cos(m.WD[j]*tau),sj=e*sin(m.WD[j]*tau);double q=B[j]*cj+C[j]*sj,qd=-m.Z[j]*q+m.WD[j]*(C[j]*cj-B[j]*sj);for(int i=0;i<2;i++){X[i]+=m.PS[i][j]*q;V[i]+=m.PS[i][j]*qd;}}
    for(int i=0;i<2;i++){if(s.mask>>i&1){X[i]=p.s[i];V[i]=0;}s.x[i]=X[i];s.v[i]=V[i]; if(tau>0)just[i]=0;}
    bool jump=false; bool hit[2]={false,false};
    for(int i=0;i<2;i++)if(!(s.mask>>i&1)){double gap=p.sg[i]*(p.s[i]-s.x[i]),gd=-p.sg[i]*s.v[i]; if(gap<=gtol&&gd<0){double vi=s.v[i];s.x[i]=p.s[i];s.v[i]=-p.r*vi;just[i]=1;hit[i]=true;NEV++;cb(i,t,s.th,vi);jump=true;}}
    force(p,s.x,s.v,co,f); for(int i=0;i<2;i++)a[i]=(s.mask>>i&1)?0:f[i]; force(p,s.v,a,0,fd); fd[0]-=p.A*p.Om*si;
    for(int i=0;i<2;i++) if(hit[i]){ double lam=p.sg[i]*f[i],ld=p.sg[i]*fd[i],vp=fabs(s.v[i]); if(lam>0&&vp<vst){double Tc=2*vp/(lam*(1-p.r)+1e-300); if(vp<1e-13||(Tc<1e-3&&lam+2*min(ld,0.0)*Tc>0)){s.v[i]=0;s.mask|=1<<i;NST++;just[i]=0;}} else if(lam<=0&&vp<1e-13){s.v[i]=0;just[i]=lam<0?2:3;} }
    for(int i=0;i<2;i++)if(!hit[i]&&(s.mask>>i&1)&&p.sg[i]*f[i]<=0){s.mask&=~(1<<i);NREL++; just[i]=(jump&&p.sg[i]*f[i]<-1e-9)?2:3; }
  } }
int main(int argc,char**argv){ double s1=atof(argv[1]),s2=atof(argv[2]),A=atof(argv[3]),O0=atof(argv[4]),O1=atof(argv[5]);int n=atoi(argv[6]);int nt=atoi(argv[7]),nr=atoi(argv[8]);double Umax=atof(argv[9]);int print=atoi(argv[10]); double r=argc>11?atof(argv[11]):0.7; double vst=argc>12?atof(argv[12]):1e-6; double seed=argc>13?atof(argv[13]):0;
  auto T0=chrono::steady_clock::now(); for(int a=0;a<n;a++){ Par p;p.s[0]=s1;p.s[1]=s2;p.sg[0]=s1>=0?1:-1;p.sg[1]=s2>=0?1:-1;p.r=r;p.A=A;p.c=0.1;p.k=1;p.Om=n>1?O0+(O1-O0)*a/(n-1):O0; Modal M[4];for(int q=0;q<4;q++)build(p,q,M[q]); St s;memset(&s,0,sizeof s); if(seed>0){srand48((long)seed+a*0);for(int i=0;i<2;i++){s.x[i]=p.s[i]-p.sg[i]*drand48()*1.0;s.v[i]=2*(drand48()-0.5);}} double Tp=2*M_PI/p.Om; long it0=NIT;int just[2]={0,0};
    for(int q=0;q<nt;q++){s.th=0;adv(p,M,s,Tp,1e-14,vst,Umax,[](int,double,double,double){},just);} int c[2]={0,0};long st0=NST;vector<double> vs[2]; for(int q=0;q<nr;q++){s.th=0;adv(p,M,s,Tp,1e-14,vst,Umax,[&](int i,double t,double,double v){c[i]++;vs[i].push_back(v);if(print==2)::printf("%d %.17g\n",i,q*Tp+t);},just);}
    if(print==1){printf("Om=%.4f it/per %.1f m1 %.3f m2 %.3f stick %.2f |",p.Om,(NIT-it0)/(double)(nt+nr),c[0]/(double)nr,c[1]/(double)nr,(NST-st0)/(double)nr);for(int i=0;i<2;i++){for(int q=0;q<min<int>(5,vs[i].size());q++)printf(" %.5f",vs[i][q]);printf(" |");}printf("\n");} }
  double dt=chrono::duration<double>(chrono::steady_clock::now()-T0).count(); double lp=(double)n*(nt+nr); fprintf(stderr,"%.3f s, %.2f us/lane-period, it/lp %.2f ev/lp %.2f ns/it %.1f stick %ld rel %ld\n",dt,dt/lp*1e6,NIT/lp,NEV/lp,dt/NIT*1e9,NST,NREL); }
